//! Holding strands off solids by the planes of their touches, and keeping their lengths.
//!
//! A touch remembers where a strand was near a solid: a plane, fixed to the solid, that the strand must not cross where it passes,
//! however far both move (docs/DEVIATIONS.md, residual correction). Between two looks at the solid that is all that is known of it.
//! Everything is in the head frame; strands are three arrays of `pad` values, cm.

use crate::correct::{Moving, Skins, Surroundings};
use crate::interpolate::MAX_PARTICLES;
use crate::offset::N_FIXED;
use crate::response::Response;
use crate::solid_in_head::{Frame, SolidInHead, particle};
use crate::strands::{Slot, Touch};
use multiversion::multiversion;

/// Squares of the least and largest share of its rest length that a skinned segment may have and keep.
const LEAST_LENGTH2: f32 = 0.95 * 0.95;
const MOST_LENGTH2: f32 = 1.05 * 1.05;

/// Sweeps over the touches: those close together answer each other.
const SWEEPS: usize = 2;

#[inline(always)]
pub(crate) fn point_at(x: &[f32], pad: usize, segment: usize, s: f32) -> [f32; 3] {
    let at = |i: usize| x[i] + (x[i + 1] - x[i]) * s;
    [at(segment), at(pad + segment), at(2 * pad + segment)]
}

#[inline(always)]
pub(crate) fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub(crate) fn less(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub(crate) fn scaled(a: [f32; 3], s: f32) -> [f32; 3] {
    [a[0] * s, a[1] * s, a[2] * s]
}

/// Gap of a point (solid's frame) to the plane of a touch, less the distance kept, cm.
#[inline(always)]
pub(crate) fn plane_gap(touch: &Touch, point: [f32; 3]) -> f32 {
    touch.gap + dot(less(point, touch.point), touch.normal)
}

/// Where the strand now passes the place of a touch: its nearest point to it on the segment it passed last or one next to it.
#[inline(always)]
fn pass(touch: &mut Touch, frame: &Frame, x: &[f32], pad: usize, n: usize) -> [f32; 3] {
    let mut j = usize::from(touch.segment);
    for _ in 0..3 {
        let (a, b) = (frame.point(particle(x, pad, j)), frame.point(particle(x, pad, j + 1)));
        let along = less(b, a);
        let s = dot(less(touch.point, a), along) / dot(along, along).max(1e-12);
        if s < 0.0 && j > N_FIXED - 1 {
            j -= 1;
        } else if s > 1.0 && j + 2 < n {
            j += 1;
        } else {
            (touch.segment, touch.s) = (j as u16, s.clamp(0.0, 1.0));
            break;
        }
    }
    frame.point(point_at(x, pad, usize::from(touch.segment), touch.s))
}

/// Gap to the plane of a touch where the strand now passes it, cm. What was in the solid before is let out once it is looked at: it
/// counts from where it was.
#[inline(always)]
fn gap_where_it_passes(touch: &mut Touch, frame: &Frame, x: &[f32], pad: usize, n: usize) -> f32 {
    let y = pass(touch, frame, x, pad, n);
    plane_gap(touch, y) - touch.gap.min(0.0)
}

/// Keeps the strand on its side of the plane of every touch, where it passes, and no deeper behind one than it was; returns whether it
/// had to.
pub(crate) fn hold_at_planes(
    around: &Surroundings,
    response: &Response,
    slot: &mut Slot,
    alpha: f32,
    friction: Option<&Skins>,
    work: &mut Moving,
) -> bool {
    let (pad, n) = (around.pad, around.n);
    let (mut pushed, mut start_known) = (false, false);
    for sweep in 0..SWEEPS {
        let mut again = false;
        for touch in &mut slot.touches[..usize::from(slot.n_touches)] {
            let solid = &around.solids[usize::from(touch.solid)];
            let turned;
            let frame = if alpha >= 1.0 {
                &solid.at_end
            } else {
                turned = solid.at(f64::from(alpha));
                &turned
            };
            let gap = gap_where_it_passes(touch, frame, &work.x, pad, n);
            if gap >= 0.0 {
                continue;
            }
            let at = (usize::from(touch.segment), touch.s);
            let mut by = frame.vector_back(scaled(touch.normal, -gap));
            if let Some(skins) = friction.filter(|_| sweep == 0) {
                if !start_known {
                    skins.at_start(slot.strand as usize, &mut work.old_skin);
                    start_known = true;
                }
                by = less(by, slowed_by_friction(pad, solid, at, -gap, work));
            }
            response.push_at(at.0, at.1, by, &mut work.x);
            again = true;
        }
        pushed |= again;
        if !again {
            break;
        }
    }
    pushed
}

/// What friction takes off the way that the strand slides over the solid in this step, head frame, cm; `work.old_skin` holds the strand
/// skinned at its start.
fn slowed_by_friction(
    pad: usize,
    solid: &SolidInHead,
    (segment, s): (usize, f32),
    pressed: f32,
    work: &Moving,
) -> [f32; 3] {
    let now = point_at(&work.x, pad, segment, s);
    // Where the same point of the strand was, and where the solid would have carried it.
    let skin = point_at(&work.old_skin, pad, segment, s);
    let offset = point_at(&work.offset, pad, segment, s);
    let was = [skin[0] + offset[0], skin[1] + offset[1], skin[2] + offset[2]];
    let carried = solid.carried(was);
    let slide = less(now, carried);
    let length = dot(slide, slide).sqrt();
    if length <= 0.0 {
        return [0.0; 3];
    }
    scaled(slide, (solid.solid.friction * pressed).min(length) / length)
}

/// As [`hold_at_planes`] for a strand that is only shown: `touches` are its own copy, `frames` turn the head's frame into each solid's
/// now; returns whether it had to.
pub(crate) fn hold_where_shown(
    touches: &mut [Touch],
    frames: &[Frame],
    response: &Response,
    x: &mut [f32],
    pad: usize,
    n: usize,
) -> bool {
    let mut pushed = false;
    for _ in 0..SWEEPS {
        let mut again = false;
        for touch in &mut *touches {
            let frame = &frames[usize::from(touch.solid)];
            let gap = gap_where_it_passes(touch, frame, x, pad, n);
            if gap < 0.0 {
                let by = frame.vector_back(scaled(touch.normal, -gap));
                response.push_at(usize::from(touch.segment), touch.s, by, x);
                again = true;
            }
        }
        pushed |= again;
        if !again {
            break;
        }
    }
    pushed
}

/// Gives every segment the length that it has on the skinned strand, or nearly that at rest, directions kept; the offset at the start goes
/// with it, so that nothing of that counts as velocity.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
pub(crate) fn keep_lengths(skin: &[f32], rest: &[f32], x: &mut [f32], offset: &mut [f32], pad: usize, n: usize) {
    let mut now = [0.0f32; MAX_PARTICLES];
    let mut wanted = [0.0f32; MAX_PARTICLES];
    let mut at_rest = [0.0f32; MAX_PARTICLES];
    for (out, v) in [(&mut now, &*x), (&mut wanted, skin), (&mut at_rest, rest)] {
        let (x, rest) = v.split_at(pad);
        let (y, z) = rest.split_at(pad);
        for i in 0..n - 1 {
            let d = [x[i + 1] - x[i], y[i + 1] - y[i], z[i + 1] - z[i]];
            out[i] = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        }
    }
    let mut scale = [1.0f32; MAX_PARTICLES];
    for i in 0..n - 1 {
        let length2 = wanted[i].max(at_rest[i] * LEAST_LENGTH2).min(at_rest[i] * MOST_LENGTH2);
        scale[i] = (length2 / now[i].max(1e-12)).sqrt();
    }
    for c in 0..3 {
        let (x, offset) = (&mut x[c * pad..(c + 1) * pad], &mut offset[c * pad..(c + 1) * pad]);
        let mut before = x[N_FIXED - 1];
        let mut at = before;
        for i in N_FIXED..n {
            let along = x[i] - before;
            before = x[i];
            at += along * scale[i - 1];
            offset[i] += at - x[i];
            x[i] = at;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::response::Elasticity;
    use nalgebra::{Isometry3, Vector3};

    const PAD: usize = 32;
    const N: usize = 25;

    /// Three arrays of `PAD` values of strands a centimetre a segment, bent by `bend`.
    fn strand(bend: f32) -> Vec<f32> {
        let mut x = vec![0.0; 3 * PAD];
        for i in 1..PAD {
            let angle = bend * i as f32;
            let step = [angle.sin(), -angle.cos(), 0.0];
            for c in 0..3 {
                x[c * PAD + i] = x[c * PAD + i - 1] + step[c];
            }
        }
        x
    }

    fn lengths(x: &[f32]) -> Vec<f32> {
        let at = |i: usize| Vector3::from(particle(x, PAD, i));
        (N_FIXED..N).map(|i| (at(i) - at(i - 1)).norm()).collect()
    }

    #[test]
    fn lengths_are_kept_and_that_gives_no_velocity() {
        /// Lengths and differences of positions of up to 25 cm in single precision.
        const ROUND_OFF_CM: f32 = 2e-5;
        let (skin, mut x) = (strand(0.02), strand(-0.05));
        // Stretched as free flight and pushes leave it.
        for (k, v) in x.iter_mut().enumerate() {
            *v *= 1.0 + 0.05 * ((k % 5) as f32);
        }
        let mut offset: Vec<f32> = (0..3 * PAD).map(|k| 0.1 * (k as f32).sin()).collect();
        let moved: Vec<f32> = x.iter().zip(&offset).map(|(x, d)| x - d).collect();
        assert!(lengths(&x).iter().any(|l| (l - 1.0).abs() > 0.1));
        keep_lengths(&skin, &skin, &mut x, &mut offset, PAD, N);
        for (now, wanted) in lengths(&x).iter().zip(lengths(&skin)) {
            assert!((now - wanted).abs() < ROUND_OFF_CM, "{now} {wanted}");
        }
        for ((x, d), before) in x.iter().zip(&offset).zip(&moved) {
            assert!(
                (x - d - before).abs() < ROUND_OFF_CM,
                "velocity is what the strand has moved from its offset at the start"
            );
        }
    }

    #[test]
    fn a_strand_shown_between_meetings_lies_in_front_of_its_planes_wherever_their_solid_has_gone() {
        /// Each plane is held where the strand passes it; pushes at others nearby move that by no more.
        const BEHIND_CM: f32 = 0.02;
        let material = strand_sim::Material::straight();
        let of = Elasticity { spacing_cm: 1.0, material: &material, gravity_cm_per_s2: 981.0, return_rate: 5.0 };
        let response = Response::new(N, PAD, of, 0.01);
        let plane = |segment: u16, x: f32| Touch {
            solid: 0,
            segment,
            s: 0.5,
            gap: 0.05,
            point: [0.0, -f32::from(segment) - 0.5, 0.0],
            normal: [x, 0.0, 0.0],
        };
        for shift in [0.0, 0.1, 0.3] {
            let frame = Frame::new(&Isometry3::translation(-shift, 0.0, 0.0));
            let mut touches = [plane(8, 1.0), plane(15, 1.0)];
            let mut x = strand(0.0);
            let held = hold_where_shown(&mut touches, &[frame], &response, &mut x, PAD, N);
            assert_eq!(held, shift > 0.05, "nothing moves before the gap is used up");
            for touch in &touches {
                let at = frame.point(point_at(&x, PAD, usize::from(touch.segment), touch.s));
                assert!(plane_gap(touch, at) > -BEHIND_CM, "{shift}: {}", plane_gap(touch, at));
            }
        }
    }
}
