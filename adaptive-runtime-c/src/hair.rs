//! A runtime with what a host does not want to carry: the poses of the last step, worker threads, and whether all is well.

use crate::error::Error;
use crate::guard::workers;
use crate::solids::AhSolid;
use crate::types::{AhParams, AhPose, AhReport};
use adaptive_runtime::{Runtime, StepInput};
use io_formats::SkinningModel;
use nalgebra::Isometry3;
use rayon::ThreadPool;

/// A trained skinning model.
#[derive(Debug)]
pub struct AhModel {
    pub(crate) model: SkinningModel,
}

/// The hair of one head, in motion among solids.
#[derive(Debug)]
pub struct AhHair {
    runtime: Runtime,
    pool: ThreadPool,
    /// Poses at the end of the next step.
    world_from_head: Isometry3<f64>,
    world_from_solids: Vec<Isometry3<f64>>,
    /// Cleared while the runtime changes, and left so by a panic.
    is_whole: bool,
}

impl AhHair {
    pub(crate) fn new(
        model: &AhModel,
        params: &AhParams,
        world_from_head: &AhPose,
        head: Option<&AhSolid>,
        solids: &[&AhSolid],
        world_from_solids: &[AhPose],
    ) -> Result<Self, Error> {
        let runtime_params = params.runtime_params()?;
        let world_from_head = world_from_head.isometry("the pose of the head")?;
        let poses: Vec<_> =
            world_from_solids.iter().map(|pose| pose.isometry("the pose of a solid")).collect::<Result<_, _>>()?;
        let pool = workers(params.n_threads as usize)?;
        let head = head.map(|head| head.solid.clone());
        let solids = solids.iter().map(|solid| solid.solid.clone()).collect();
        // The runtime owns its model; a host may make several heads of one.
        let model = model.model.clone();
        let runtime = pool
            .install(|| Runtime::new(model, runtime_params, world_from_head, head, solids, &poses))
            .map_err(Error::Runtime)?;
        Ok(Self { runtime, pool, world_from_head, world_from_solids: poses, is_whole: true })
    }

    pub(crate) fn set_head_pose(&mut self, pose: &AhPose) -> Result<(), Error> {
        self.world_from_head = pose.isometry("the pose of the head")?;
        Ok(())
    }

    pub(crate) fn set_solid_pose(&mut self, solid: u32, pose: &AhPose) -> Result<(), Error> {
        let n_solids = self.world_from_solids.len();
        let kept = self.world_from_solids.get_mut(solid as usize).ok_or(Error::UnknownSolid { solid, n_solids })?;
        *kept = pose.isometry("the pose of a solid")?;
        Ok(())
    }

    pub(crate) fn put_head(&mut self, pose: &AhPose) -> Result<(), Error> {
        self.set_head_pose(pose)?;
        self.change(|runtime, world_from_head, _| runtime.put_head(&world_from_head))
    }

    pub(crate) fn put_solid(&mut self, solid: u32, pose: &AhPose) -> Result<(), Error> {
        self.set_solid_pose(solid, pose)?;
        let solid = solid as usize;
        self.change(|runtime, _, world_from_solids| runtime.put_solid(solid, &world_from_solids[solid]))
    }

    pub(crate) fn step(&mut self, dt_s: f64) -> Result<AhReport, Error> {
        if !(dt_s.is_finite() && dt_s > 0.0) {
            return Err(Error::Value { what: "dt_s", value: dt_s, expected: "finite and greater than zero" });
        }
        self.change(|runtime, world_from_head, world_from_solids| {
            AhReport::from(&runtime.step(&StepInput { dt: dt_s, world_from_head, world_from_solids }))
        })
    }

    pub(crate) fn read(&mut self) -> Result<(), Error> {
        self.change(|runtime, _, _| read(runtime))
    }

    /// Runs a change on the worker threads; a panic in it leaves this hair refused for good.
    fn change<T: Send>(
        &mut self,
        work: impl FnOnce(&mut Runtime, Isometry3<f64>, &[Isometry3<f64>]) -> T + Send,
    ) -> Result<T, Error> {
        if !std::mem::replace(&mut self.is_whole, false) {
            return Err(Error::Broken);
        }
        let (runtime, poses) = (&mut self.runtime, &self.world_from_solids);
        let head = self.world_from_head;
        let out = self.pool.install(|| work(runtime, head, poses));
        self.is_whole = true;
        Ok(out)
    }

    /// The runtime, for questions.
    pub(crate) fn runtime(&self) -> Result<&Runtime, Error> {
        if self.is_whole { Ok(&self.runtime) } else { Err(Error::Broken) }
    }

    pub(crate) fn n_solids(&self) -> usize {
        self.world_from_solids.len()
    }
}

/// Brings the positions of all hair up to date.
fn read(runtime: &mut Runtime) {
    runtime.read();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guard::guarded;
    use crate::types::{AH_MODE_ADAPTIVE, AhStatus};
    use hair_tests::models::Row;

    #[test]
    fn hair_that_met_a_defect_is_refused_from_then_on() {
        let model = AhModel { model: Row::of_three_guides().model() };
        let params = AhParams { n_threads: 1, ..AhParams::of_mode(AH_MODE_ADAPTIVE).unwrap() };
        let mut hair = AhHair::new(&model, &params, &AhPose::identity(), None, &[], &[]).unwrap();
        hair.step(0.01).unwrap();
        assert_eq!(guarded(|| hair.change(|_, _, _| panic!("a planted defect"))), AhStatus::Panicked);
        assert!(matches!(hair.step(0.01), Err(Error::Broken)));
        assert!(matches!(hair.read(), Err(Error::Broken)) && matches!(hair.runtime(), Err(Error::Broken)));
    }
}
