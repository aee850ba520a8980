//! Every hair where it is now: skinned, with what it carries (AS16 Eq. 5), in the world frame.

use crate::hair_hair::ReadPoses;
use crate::interpolate::{MAX_PARTICLES, interpolate_to_points};
use crate::offset::Return;
use crate::runtime::Runtime;
use crate::solid_in_head::Frame;
use nalgebra::Isometry3;
use rayon::prelude::*;

/// Strands read together by one worker.
const CHUNK: usize = 512;

impl Runtime {
    /// Brings [`Runtime::positions`] up to date and keeps the ones before as [`Runtime::previous_positions`].
    ///
    /// Costs little more than copying all positions; steps between reads do without. How often one reads changes nothing else.
    pub fn read(&mut self) {
        std::mem::swap(&mut self.positions, &mut self.previous);
        let strands = &self.strands;
        let (n, pad) = (strands.n_particles, strands.pad);
        let (transforms, time, rate) = (&self.guides.arrays, self.time, self.params.residual.return_rate);
        // Hair at rest on a head that has not moved is reproduced to the bit.
        let frame = (self.world_from_head != Isometry3::identity()).then(|| Frame::new(&self.world_from_head));
        self.positions.par_chunks_mut(CHUNK * n).enumerate().for_each(|(chunk, positions)| {
            let mut skin = [0.0f32; 3 * MAX_PARTICLES];
            for (k, out) in positions.chunks_exact_mut(n).enumerate() {
                let strand = chunk * CHUNK + k;
                let rest = &strands.rest[strand * 3 * pad..(strand + 1) * 3 * pad];
                let at = strands.slot_of[strand] as usize;
                let fade = &strands.fades[at];
                let carried = fade.carries(time).then(|| {
                    (&strands.carried[at * 6 * pad..(at + 1) * 6 * pad], Return::over(time - fade.stamp, rate))
                });
                let active = &strands.active[strand];
                let skin = &mut skin[..3 * pad];
                interpolate_to_points(rest, &strands.u, active, transforms, carried, frame.as_ref(), skin, out);
            }
        });
        if let Some(hair_hair) = &mut self.hair_hair {
            let poses = ReadPoses {
                world_from_head: self.world_from_head,
                previous: Some((&self.previous, self.world_from_head_read)),
            };
            // What is near a solid stays where contact has put it.
            hair_hair.correct(&mut self.positions, &poses, |strand| strands.clearance(strand));
        }
        self.world_from_head_read = self.world_from_head;
    }
}
