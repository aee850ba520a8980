//! The guides: simulated strands, their transforms and their motion in the head frame.

use crate::error::Error;
use crate::graph::GuideMotion;
use crate::guides_dftl::Dftl;
use crate::interpolate::TransformArrays;
use crate::params::{GuideIntegrator, RuntimeParams};
use collision::{MovingSolid, Solid, SolidPose};
use io_formats::guide_transform::{Blend, DisplacementTransform, guide_transforms};
use io_formats::skinning_model::{MaterialRecord, SkinningModel};
use nalgebra::{Isometry3, Point3, Vector3};
use strand_sim::interaction::LinkSet;
use strand_sim::{
    ALTITUDE_PER_TWIST, InteractionParams, InteractionWorkspace, Material, StepInput, StepParams, StepReport,
    StepWorkspace, StrandState, StrandSystem,
};

/// A model's material as the simulator reads it.
#[must_use]
pub fn material_of(record: &MaterialRecord) -> Material {
    Material {
        stretch_dyn: record.stretch_dyn,
        bend_dyn: record.bend,
        twist_dyn: record.twist,
        stretch_damping: record.stretch_damping,
        bend_damping: record.bend_damping,
        twist_damping: record.twist_damping,
        // Altitude springs follow from torsion springs: the file need not hold them.
        altitude_dyn: ALTITUDE_PER_TWIST * record.twist,
        altitude_damping: record.twist_damping,
        friction: record.friction,
        linear_density_g_per_cm: record.linear_density_g_per_cm,
        air_drag_per_s: record.air_drag_per_s,
    }
}

/// A material as the model file holds it.
#[must_use]
pub fn record_of(material: &Material) -> MaterialRecord {
    MaterialRecord {
        stretch_dyn: material.stretch_dyn,
        bend: material.bend_dyn,
        twist: material.twist_dyn,
        stretch_damping: material.stretch_damping,
        bend_damping: material.bend_damping,
        twist_damping: material.twist_damping,
        friction: material.friction,
        linear_density_g_per_cm: material.linear_density_g_per_cm,
        air_drag_per_s: material.air_drag_per_s,
    }
}

#[derive(Debug)]
pub(crate) struct Guides {
    n_particles: usize,
    blend: Blend,
    dynamics: Dynamics,
    /// Guide-major, head frame, cm.
    rest: Vec<[f32; 3]>,
    position_in_head: Vec<[f32; 3]>,
    /// cm/s.
    velocity_in_head: Vec<[f32; 3]>,
    position_in_solids: Vec<Vec<Vector3<f32>>>,
    transforms: Vec<DisplacementTransform>,
    pub(crate) arrays: TransformArrays,
}

/// What moves the guides; the state is kept in the world frame.
#[derive(Debug)]
enum Dynamics {
    Springs(Box<Springs>),
    Dftl(Dftl),
}

#[derive(Debug)]
struct Springs {
    system: StrandSystem,
    state: StrandState,
    workspace: StepWorkspace,
    /// How guides meet each other, with what they remember of that.
    interaction: Option<(InteractionParams, LinkSet, InteractionWorkspace)>,
}

impl Guides {
    /// `head` is what the guides rest on; `params` says under what gravity they do.
    pub(crate) fn new(
        model: &SkinningModel,
        world_from_head: &Isometry3<f64>,
        head: Option<&Solid>,
        params: &RuntimeParams,
    ) -> Result<Self, Error> {
        let n = model.n_particles as usize;
        let groom: Vec<Vector3<f64>> =
            model.groom_in_head.chunks_exact(3).map(|p| Vector3::new(p[0], p[1], p[2]).cast()).collect();
        let rest: Vec<[f32; 3]> =
            model.guide_strands.iter().flat_map(|&s| model.rest_of(s as usize).iter().copied()).collect();
        let shape: Vec<Vector3<f64>> = rest.iter().map(|&p| Vector3::from(p).cast()).collect();
        let dynamics = match params.guide_integrator {
            GuideIntegrator::FollowTheLeader(dftl) => {
                let density = model.material.linear_density_g_per_cm;
                Dynamics::Dftl(Dftl::new(shape, n, density, world_from_head, dftl))
            }
            GuideIntegrator::Springs => {
                let mut system = StrandSystem::new(&groom, n, material_of(&model.material))?;
                let pose = SolidPose::still(Isometry3::identity());
                let head: Vec<_> = head.map(|solid| MovingSolid { solid, pose }).into_iter().collect();
                // As the full-space simulation that the model was trained on.
                let (settled, _) = system.hold_settled(&shape, &head, &params.guides)?;
                let state = settled.carried(world_from_head);
                let interaction = params
                    .guide_interaction
                    .map(|interaction| (interaction, LinkSet::default(), InteractionWorkspace::default()));
                Dynamics::Springs(Box::new(Springs { system, state, workspace: StepWorkspace::default(), interaction }))
            }
        };
        Ok(Self {
            n_particles: n,
            blend: model.blend,
            dynamics,
            position_in_head: rest.clone(),
            velocity_in_head: vec![[0.0; 3]; rest.len()],
            position_in_solids: Vec::new(),
            transforms: vec![DisplacementTransform::default(); n],
            arrays: TransformArrays::new(model.n_guides(), n, model.blend),
            rest,
        })
    }

    pub(crate) fn step(
        &mut self,
        input: &StepInput,
        world_from_head: &Isometry3<f64>,
        params: &StepParams,
    ) -> StepReport {
        let report = match &mut self.dynamics {
            Dynamics::Springs(springs) => springs.step(input, params),
            Dynamics::Dftl(dftl) => dftl.step(input, params),
        };
        let head_from_world = world_from_head.inverse();
        // As a matrix: half the work of a quaternion's two cross products.
        let (turn, shift) = (head_from_world.rotation.to_rotation_matrix(), head_from_world.translation.vector);
        let n = self.n_particles;
        let per_s = (1.0 / input.dt) as f32;
        let (position, velocity) = (&mut self.position_in_head, &mut self.velocity_in_head);
        let mut take = |at: usize, world: Vector3<f64>| {
            let now: [f32; 3] = (turn * world + shift).cast::<f32>().into();
            for c in 0..3 {
                velocity[at][c] = (now[c] - position[at][c]) * per_s;
            }
            position[at] = now;
        };
        match &self.dynamics {
            Dynamics::Springs(s) => s.system.read(&s.state, |guide, i, world, _| take(guide * n + i, world)),
            Dynamics::Dftl(dftl) => dftl.position().iter().enumerate().for_each(|(at, &world)| take(at, world)),
        }
        self.update_transforms();
        report
    }

    fn update_transforms(&mut self) {
        let n = self.n_particles;
        for guide in 0..self.rest.len() / n {
            let of = guide * n..(guide + 1) * n;
            let (rest, current) = (&self.rest[of.clone()], &self.position_in_head[of]);
            if self.blend == Blend::Translation {
                self.arrays.set_guide_moved(guide, rest, current);
            } else {
                guide_transforms(rest, current, self.blend, &mut self.transforms);
                self.arrays.set_guide(guide, &self.transforms);
            }
        }
    }

    /// Carries all guides rigidly from one head pose to another, as if nothing had happened between: for a head that is put
    /// elsewhere, which would otherwise tear its hair along. Places and velocities in the head frame stay as they are.
    pub(crate) fn carry_to(&mut self, from: &Isometry3<f64>, to: &Isometry3<f64>) {
        let to_there = to * from.inverse();
        match &mut self.dynamics {
            Dynamics::Springs(springs) => springs.state.carry(&to_there),
            Dynamics::Dftl(dftl) => dftl.carry(&to_there),
        }
    }

    /// Places all guides in the head frame directly, for tests and replays; velocities become zero.
    pub(crate) fn place(&mut self, position_in_head: &[[f32; 3]]) {
        self.position_in_head.copy_from_slice(position_in_head);
        self.velocity_in_head.fill([0.0; 3]);
        self.update_transforms();
    }

    /// Motion of all guides, with their positions in the frames of `solids` at the end of the step.
    pub(crate) fn motion(&mut self, world_from_head: &Isometry3<f64>, solids: &[MovingSolid]) -> GuideMotion<'_> {
        self.position_in_solids.resize_with(solids.len(), Vec::new);
        for (solid, out) in solids.iter().zip(&mut self.position_in_solids) {
            let solid_from_head = (solid.pose.to.inverse() * world_from_head).cast::<f32>();
            out.clear();
            out.extend(self.position_in_head.iter().map(|&p| (solid_from_head * Point3::from(p)).coords));
        }
        GuideMotion {
            n_particles: self.n_particles,
            position_in_head: &self.position_in_head,
            velocity_in_head: &self.velocity_in_head,
            position_in_solids: &self.position_in_solids,
        }
    }

    pub(crate) fn position_in_head(&self) -> &[[f32; 3]] {
        &self.position_in_head
    }
}

impl Springs {
    fn step(&mut self, input: &StepInput, params: &StepParams) -> StepReport {
        match &mut self.interaction {
            None => self.system.step(&mut self.state, input, params, &mut self.workspace),
            Some((interaction, links, workspace)) => {
                self.system.step_interacting(&mut self.state, links, input, params, interaction, workspace).step
            }
        }
    }
}
