//! What residual correction is compared with: the force of AS16 §5.1 alone, and particles moved out one by one (Chai 2014).

use super::{Hold, MAX_SOLIDS, Members, Outcome, Surroundings, Travel, Work, all, look};
use crate::kernels::{Carry, run};
use crate::offset::{N_FIXED, Return};
use crate::params::Correction;
use crate::planes::{plane_gap, point_at, scaled};
use crate::solid_in_head::{Frame, particle};
use crate::strands::{Fade, Wake};
use arrayvec::ArrayVec;
use nalgebra::Vector3;

/// What is compared with: nothing but the force that AS16 §5.1 puts on a strand in a solid, or its particles moved out
/// one by one at the end of the step (Chai 2014), which the next step knows nothing of.
pub(super) fn correct_at_end(
    around: &Surroundings,
    members: &mut Members,
    awake: &[u8],
    travel: Travel,
    reach: f32,
    work: &mut Work,
    holds: &mut Vec<Hold>,
    outcome: &mut impl FnMut(Outcome, f32),
) {
    let pad = around.pad;
    let back = Return::over(around.dt, around.params.residual.return_rate);
    for w in &mut work.strands[..awake.len()] {
        run(Carry { skin: &w.skin, offset: &w.offset, velocity: &w.velocity, back, x: &mut w.x });
    }
    let frames: ArrayVec<Frame, MAX_SOLIDS> = around.solids.iter().map(|solid| solid.at_end).collect();
    look(around, members.slots, awake, &all(awake.len()), &frames, reach, work);
    let gap_kept = around.params.guides.contact.offset_cm as f32;
    for ((w, &clear), &k) in work.strands.iter_mut().zip(&work.clear).zip(awake) {
        let k = usize::from(k);
        let slot = &mut members.slots[k];
        members.wakes[k] = Wake { at: travel.total, from: f64::INFINITY };
        if slot.n_touches == 0 {
            members.wakes[k].at += f64::from(clear);
            outcome(Outcome::Away, 0.0);
            continue;
        }
        let mut inside = false;
        for touch in &slot.touches[..usize::from(slot.n_touches)] {
            let depth = -(touch.gap + gap_kept);
            if depth > 0.0 {
                inside = true;
                let normal = around.solids[usize::from(touch.solid)].at_end.vector_back(touch.normal);
                holds.push(Hold {
                    strand: slot.strand,
                    segment: touch.segment,
                    s: touch.s,
                    held: scaled(normal, depth),
                });
            }
        }
        if around.params.residual.correction == Correction::Position {
            for solid in around.solids {
                for i in N_FIXED..around.n {
                    let p = Vector3::from(solid.at_end.point(particle(&w.x, pad, i)));
                    let (distance, normal) = solid.solid.sdf.outward_normal(p);
                    if distance < gap_kept {
                        let by = solid.at_end.vector_back((normal * (gap_kept - distance)).into());
                        for c in 0..3 {
                            w.x[c * pad + i] += by[c];
                        }
                    }
                }
            }
            let (offset, velocity) = members.carried[k * 6 * pad..(k + 1) * 6 * pad].split_at_mut(3 * pad);
            for ((d, x), s) in offset.iter_mut().zip(&w.x).zip(&w.skin) {
                *d = x - s;
            }
            velocity.fill(0.0);
            // There for whoever reads this step, gone in the next.
            members.fades[k] = Fade { stamp: around.time, gone_at: around.time + 0.5 * around.dt };
        }
        let left = slot.touches[..usize::from(slot.n_touches)].iter().fold(f32::NEG_INFINITY, |most, touch| {
            let at = point_at(&w.x, pad, usize::from(touch.segment), touch.s);
            most.max(-(plane_gap(touch, around.solids[usize::from(touch.solid)].at_end.point(at)) + gap_kept))
        });
        outcome(if inside { Outcome::Pushed } else { Outcome::Near }, left);
    }
}
