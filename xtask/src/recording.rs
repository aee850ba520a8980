//! The part of training that simulates: hair settled on its head, and frames of every head motion.
//!
//! Each motion's frames are a store of their own, named by a hash of hair, motion and parameters: motions may be recorded by
//! several processes, on one machine or many that share a folder, and read together afterwards. A recording that was cut
//! off is simulated again from its beginning, and what is on disk already is not written again.

use crate::progress::Bars;
use anyhow::Result;
use hair_bench::full_space::{FullSpace, rubbing_params, settle};
use hair_bench::training_motions::TrainingMotion;
use hair_bench::world::World;
use io_formats::frames::{FrameInfo, FrameSource, FrameStore, FrameStoreWriter};
use io_formats::groom::UniformGroom;
use io_formats::stage_cache::{StageCache, StageCost, hash_of, stage_key};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use strand_sim::StepParams;

/// Step of the full-space simulation that frames are recorded from, s.
const TRAIN_STEP_S: f64 = 0.01;
/// Steps that are timed without friction, beside the recorded ones with it.
const TIMED_STEPS: usize = 10;

/// Hair, and where what is recorded of it is kept.
pub struct Recorder<'a> {
    pub world: &'a World,
    pub params: StepParams,
    pub cache: &'a StageCache,
    pub folder: &'a Path,
    pub bars: &'a Bars,
    /// Hash of hair, head, material and parameters.
    pub rest_key: u64,
}

/// What one step of every strand takes.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct StepSeconds {
    /// Wall-clock seconds.
    pub wall_s: f64,
    /// CPU seconds of all threads.
    pub cpu_s: f64,
}

impl Recorder<'_> {
    fn rest_path(&self) -> PathBuf {
        self.folder.join(format!("rest-{:016x}.frames", self.rest_key))
    }

    /// The groom as it hangs, from the cache or by simulation.
    pub fn settled(&self) -> Result<UniformGroom> {
        let groom = &self.world.groom;
        let points = groom.points.clone();
        let mut rest = UniformGroom { n_strands: groom.n_strands, n_particles: groom.n_particles, points };
        let path = self.rest_path();
        let mut lock = None;
        if !path.exists() {
            lock = Some(self.cache.lock("rest", self.rest_key)?);
        }
        if path.exists() {
            FrameStore::open(&path)?.read(0, &mut rest.points)?;
            return Ok(rest);
        }
        let clock = StageCost::clock();
        let bar = self.bars.bar("settle", 100);
        let (head, material) = (&self.world.head, self.world.material);
        rest = settle(groom, head, material, &self.params, |share| bar.set_position((100.0 * share) as u64))?;
        bar.finish_and_clear();
        let mut writer = FrameStoreWriter::create(&path, rest.n_strands, rest.n_particles, self.rest_key)?;
        writer.append(FrameInfo { sequence: 0, time_s: 0.0 }, &rest.points)?;
        writer.finish()?;
        self.cache.note_cost("rest", self.rest_key, clock.cost_of(&path))?;
        drop(lock);
        // As read back: what a store keeps is rounded.
        FrameStore::open(&path)?.read(0, &mut rest.points)?;
        Ok(rest)
    }

    /// Names the frames of a motion by all they depend on.
    pub fn key(&self, motion: &TrainingMotion) -> u64 {
        let spec = &self.world.scene.train;
        let poses: Vec<u64> =
            (0..=steps_of(motion)).map(|k| hash_of(&motion.motion.pose_at(k as f64 * TRAIN_STEP_S))).collect();
        let motion_key = stage_key("motion", &poses);
        let rubbing = spec.friction.then(|| rubbing_params(self.world.groom.n_strands));
        stage_key("frames", &[self.rest_key, motion_key, spec.fps.to_bits(), hash_of(&rubbing)])
    }

    /// Each motion's frames, from the cache, continued, or recorded anew.
    pub fn frames<'m>(
        &self,
        rest: &UniformGroom,
        motions: impl Iterator<Item = &'m TrainingMotion>,
    ) -> Result<Vec<FrameStore>> {
        // What holds hair in its shape takes as long to find as twenty steps, and is the same for every motion.
        let mut at_rest = None;
        motions.map(|motion| self.frames_of(rest, &mut at_rest, motion)).collect()
    }

    fn frames_of(
        &self,
        rest: &UniformGroom,
        at_rest: &mut Option<FullSpace>,
        motion: &TrainingMotion,
    ) -> Result<FrameStore> {
        let key = self.key(motion);
        let path = self.folder.join(format!("frames-{key:016x}.frames"));
        if path.exists() {
            return Ok(FrameStore::open(&path)?);
        }
        let lock = self.cache.lock("frames", key)?;
        if path.exists() {
            return Ok(FrameStore::open(&path)?);
        }
        let clock = StageCost::clock();
        let fps = self.world.scene.train.fps;
        let steps = steps_of(motion);
        let bar = self.bars.bar(&format!("frames: {}", motion.name), steps as u64);
        let mut writer = FrameStoreWriter::resume(&path, rest.n_strands, rest.n_particles, key)?;
        // Simulated again only to go on from there.
        let mut on_disk = writer.infos().len();
        let at_rest = match at_rest {
            Some(at_rest) => at_rest,
            none => none.insert(self.world.full_space(rest, &self.params)?),
        };
        let mut full = at_rest.again();
        let mut positions = Vec::new();
        for step in 1..=steps {
            let (before, now) = ((step - 1) as f64 * TRAIN_STEP_S, step as f64 * TRAIN_STEP_S);
            let (from, to) = (motion.motion.pose_at(before), motion.motion.pose_at(now));
            let head = collision::MovingSolid { solid: &self.world.head, pose: collision::SolidPose { from, to } };
            full.step(TRAIN_STEP_S, &to, &[head]);
            if (now * fps + 1e-9).floor() > (before * fps + 1e-9).floor() {
                if on_disk > 0 {
                    on_disk -= 1;
                } else {
                    full.positions_in_head(&mut positions);
                    writer.append(FrameInfo { sequence: 0, time_s: now }, &positions)?;
                }
            }
            bar.inc(1);
        }
        bar.finish_and_clear();
        writer.finish()?;
        self.cache.note_cost("frames", key, clock.cost_of(&path))?;
        drop(lock);
        Ok(FrameStore::open(&path)?)
    }

    /// What recording a motion's frames took, if it was noted.
    pub fn cost(&self, motion: &TrainingMotion) -> Option<StageCost> {
        self.cache.cost("frames", self.key(motion))
    }

    /// What settling took, if it was noted.
    pub fn rest_cost(&self) -> Option<StageCost> {
        self.cache.cost("rest", self.rest_key)
    }

    /// What a step took on average over the recorded motions.
    pub fn seconds_per_step<'m>(&self, motions: impl Iterator<Item = &'m TrainingMotion>) -> Option<StepSeconds> {
        let (mut sum, mut steps) = (StepSeconds::default(), 0);
        for motion in motions {
            if let Some(cost) = self.cost(motion) {
                sum = StepSeconds { wall_s: sum.wall_s + cost.wall_s, cpu_s: sum.cpu_s + cost.cpu_s };
                steps += steps_of(motion);
            }
        }
        let per_step = |x: f64| x / steps.max(1) as f64;
        (steps > 0).then(|| StepSeconds { wall_s: per_step(sum.wall_s), cpu_s: per_step(sum.cpu_s) })
    }

    /// What a step takes where hairs do not rub on each other: measured once, from 0.1 s into a motion on.
    pub fn seconds_per_plain_step(&self, rest: &UniformGroom, motion: &TrainingMotion) -> Result<StepSeconds> {
        let key = self.key(motion);
        let _lock = self.cache.lock("plain-step", key)?;
        if let Ok(Some(known)) = self.cache.load("plain-step", key) {
            return Ok(known);
        }
        let bar = self.bars.bar("steps without friction", 2 * TIMED_STEPS as u64);
        let World { groom, head, material, .. } = self.world;
        let mut full = FullSpace::new(groom, rest, head, *material, &self.params)?;
        let mut clock = StageCost::clock();
        for step in 1..=2 * TIMED_STEPS {
            if step == TIMED_STEPS + 1 {
                clock = StageCost::clock();
            }
            let at = |step: usize| motion.motion.pose_at(step as f64 * TRAIN_STEP_S);
            let pose = collision::SolidPose { from: at(step - 1), to: at(step) };
            full.step(TRAIN_STEP_S, &at(step), &[collision::MovingSolid { solid: head, pose }]);
            bar.inc(1);
        }
        bar.finish_and_clear();
        let cost = clock.cost();
        let per_step = |x: f64| x / TIMED_STEPS as f64;
        let measured = StepSeconds { wall_s: per_step(cost.wall_s), cpu_s: per_step(cost.cpu_s) };
        self.cache.save("plain-step", key, &measured)?;
        Ok(measured)
    }
}

fn steps_of(motion: &TrainingMotion) -> usize {
    (motion.seconds / TRAIN_STEP_S).round() as usize
}
