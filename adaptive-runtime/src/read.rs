//! Every hair where it is now: skinned, with what it carries (AS16 Eq. 5), in the world frame.

use crate::correct::MAX_SOLIDS;
use crate::hair_hair::ReadPoses;
use crate::interpolate::{MAX_PARTICLES, interpolate, interpolate_to_points};
use crate::kernels::{Carry, run};
use crate::offset::Return;
use crate::params::Correction;
use crate::planes::{hold_where_shown, keep_lengths};
use crate::response::Response;
use crate::runtime::{Runtime, Worker};
use crate::solid_in_head::{Frame, particle};
use crate::step::PART;
use crate::strands::Strands;
use arrayvec::ArrayVec;
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
        let unmet = self.responses.first().filter(|_| self.params.residual.correction == Correction::Carried);
        let unmet = unmet.map(|table| Unmet {
            workers: &self.workers,
            step: self.step_number,
            frames: self
                .world_from_solids
                .iter()
                .map(|pose| Frame::new(&(pose.inverse() * self.world_from_head)))
                .collect(),
            response: &table.by_substeps[0],
        });
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
                if let Some(unmet) = unmet.as_ref().filter(|unmet| unmet.holds(strands, at)) {
                    interpolate(rest, &strands.u, active, transforms, skin);
                    unmet.held(strands, at, rest, skin, carried, frame.as_ref(), out);
                    continue;
                }
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

/// Strands near solids that were not met in the last step: shown in front of the planes that hold them.
struct Unmet<'a> {
    /// Each solid from the head, now.
    frames: ArrayVec<Frame, MAX_SOLIDS>,
    response: &'a Response,
    workers: &'a [Worker],
    /// Steps done.
    step: u64,
}

impl Unmet<'_> {
    /// Whether the strand in slot `at` was near a solid when its part was met, and that is not now.
    fn holds(&self, strands: &Strands, at: usize) -> bool {
        let (met, slot) = (self.workers[at / PART].met, &strands.slots[at]);
        met != self.step && slot.n_touches > 0 && slot.looked.wrapping_add(1) == met
    }

    /// Writes the strand in slot `at`, skinned to `skin`, to `out`, in the world frame.
    fn held(
        &self,
        strands: &Strands,
        at: usize,
        rest: &[f32],
        skin: &[f32],
        carried: Option<(&[f32], Return)>,
        frame: Option<&Frame>,
        out: &mut [[f32; 3]],
    ) {
        let (n, pad) = (strands.n_particles, strands.pad);
        let mut x = [0.0f32; 3 * MAX_PARTICLES];
        let x = &mut x[..3 * pad];
        match carried {
            Some((carried, back)) => {
                let (offset, velocity) = carried.split_at(3 * pad);
                run(Carry { skin, offset, velocity, back, x });
            }
            None => x.copy_from_slice(skin),
        }
        let slot = &strands.slots[at];
        let mut touches = slot.touches;
        if hold_where_shown(&mut touches[..usize::from(slot.n_touches)], &self.frames, self.response, x, pad, n) {
            keep_lengths(skin, rest, x, pad, n);
        }
        for (i, out) in out.iter_mut().enumerate() {
            let p = particle(x, pad, i);
            *out = frame.map_or(p, |frame| frame.point(p));
        }
    }
}
