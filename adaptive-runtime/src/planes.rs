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
use crate::strands::Touch;
use multiversion::multiversion;

/// Squares of the least and largest share of its rest length that a skinned segment may have and keep.
const LEAST_LENGTH2: f32 = 0.95 * 0.95;
const MOST_LENGTH2: f32 = 1.05 * 1.05;

/// Sweeps over the touches: those close together answer each other.
const SWEEPS: usize = 2;

/// Multiple of a solid's least half-thickness behind its plane from which lengths put right count as having passed it: what is less deep
/// is let out by the next look.
const PASSES_OVER_HALF_THICKNESS: f32 = 0.5;

/// Rounds over lengths and planes together, and what they leave: how far behind a plane (cm, less than the distance kept), how far off its
/// length (a share).
const ROUNDS: usize = 10;
const BEHIND_CM: f32 = 0.01;
const LENGTH_OFF: f32 = 0.02;

/// Least yield of a point of a segment beside the scalp.
const LEAST_YIELD: f32 = 0.1;

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
/// had to. The way that takes it counts as velocity. `frames` turn the head's frame into each solid's now; `friction` is of this strand
/// as it is skinned.
pub(crate) fn hold_at_planes(
    around: &Surroundings,
    response: &Response,
    touches: &mut [Touch],
    frames: &[Frame],
    friction: Option<(&Skins, usize)>,
    work: &mut Moving,
) -> bool {
    let (pad, n) = (around.pad, around.n);
    let (mut pushed, mut start_known) = (false, false);
    for sweep in 0..SWEEPS {
        let mut again = false;
        for touch in &mut *touches {
            let frame = &frames[usize::from(touch.solid)];
            let gap = gap_where_it_passes(touch, frame, &work.x, pad, n);
            if gap >= 0.0 {
                continue;
            }
            let at = (usize::from(touch.segment), touch.s);
            let mut by = frame.vector_back(scaled(touch.normal, -gap));
            if let Some((skins, strand)) = friction.filter(|_| sweep == 0) {
                if !start_known {
                    skins.at_start(strand, &mut work.old_skin);
                    start_known = true;
                }
                let solid = &around.solids[usize::from(touch.solid)];
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

/// Gives segments their lengths and leaves the strand on its side of the planes of `touches`; the offset at the start goes with it, so that
/// nothing of that counts as velocity.
///
/// Lengths are put right from the root on, which moves all that hangs below. Where that takes the strand past a solid, as it does with curls
/// that a comb draws straight, both are solved for together instead.
pub(crate) fn keep_lengths_at_planes(
    around: &Surroundings,
    touches: &mut [Touch],
    frames: &[Frame],
    rest: &[f32],
    work: &mut Moving,
) {
    let (pad, n) = (around.pad, around.n);
    let Moving { now, x, offset, before, .. } = work;
    before.copy_from_slice(x);
    keep_lengths(now, rest, x, pad, n);
    let passes = touches.iter().any(|touch| {
        let solid = usize::from(touch.solid);
        let deep = PASSES_OVER_HALF_THICKNESS * around.solids[solid].solid.half_thickness_cm;
        gap_where_it_passes(&mut touch.clone(), &frames[solid], x, pad, n) < -deep
    });
    if passes {
        x.copy_from_slice(before);
        lengths_and_planes(touches, frames, now, rest, x, pad, n);
    }
    for ((d, x), before) in offset.iter_mut().zip(&*x).zip(&*before) {
        *d += x - before;
    }
}

/// Lengths and planes together by position-based dynamics (Müller et al. 2007): each moves only the two particles beside it, all equally
/// heavy but those in the scalp.
fn lengths_and_planes(
    touches: &mut [Touch],
    frames: &[Frame],
    skin: &[f32],
    rest: &[f32],
    x: &mut [f32],
    pad: usize,
    n: usize,
) {
    let mut wanted = [0.0f32; MAX_PARTICLES];
    for i in N_FIXED - 1..n - 1 {
        wanted[i] = wanted_length2(segment_length2(skin, pad, i), segment_length2(rest, pad, i)).sqrt();
    }
    let free = |i: usize| if i < N_FIXED { 0.0 } else { 1.0 };
    for _ in 0..ROUNDS {
        let (mut off, mut held) = (0.0f32, false);
        for i in N_FIXED - 1..n - 1 {
            let along = less(particle(x, pad, i + 1), particle(x, pad, i));
            let length = dot(along, along).sqrt().max(1e-6);
            let excess = length - wanted[i];
            off = off.max(excess.abs() - LENGTH_OFF * wanted[i]);
            let by = scaled(along, excess / (length * (free(i) + 1.0)));
            for c in 0..3 {
                x[c * pad + i] += free(i) * by[c];
                x[c * pad + i + 1] -= by[c];
            }
        }
        for touch in &mut *touches {
            let frame = &frames[usize::from(touch.solid)];
            let gap = gap_where_it_passes(touch, frame, x, pad, n);
            if gap >= -BEHIND_CM {
                continue;
            }
            held = true;
            let (j, s) = (usize::from(touch.segment), touch.s);
            let shares = [(1.0 - s) * free(j), s];
            let yields = (1.0 - s) * shares[0] + s * shares[1];
            let by = frame.vector_back(scaled(touch.normal, -gap / yields.max(LEAST_YIELD)));
            for c in 0..3 {
                x[c * pad + j] += shares[0] * by[c];
                x[c * pad + j + 1] += shares[1] * by[c];
            }
        }
        if !held && off < 0.0 {
            break;
        }
    }
}

fn segment_length2(x: &[f32], pad: usize, i: usize) -> f32 {
    let along = less(particle(x, pad, i + 1), particle(x, pad, i));
    dot(along, along)
}

/// Square of the length that a segment should have: that which it has on the skinned strand, or nearly that at rest.
#[inline(always)]
fn wanted_length2(skinned2: f32, at_rest2: f32) -> f32 {
    skinned2.max(at_rest2 * LEAST_LENGTH2).min(at_rest2 * MOST_LENGTH2)
}

/// Gives every segment the length that it has on the skinned strand, or nearly that at rest, directions kept.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
pub(crate) fn keep_lengths(skin: &[f32], rest: &[f32], x: &mut [f32], pad: usize, n: usize) {
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
        scale[i] = (wanted_length2(wanted[i], at_rest[i]) / now[i].max(1e-12)).sqrt();
    }
    for c in 0..3 {
        let x = &mut x[c * pad..(c + 1) * pad];
        let mut before = x[N_FIXED - 1];
        let mut at = before;
        for i in N_FIXED..n {
            let along = x[i] - before;
            before = x[i];
            at += along * scale[i - 1];
            x[i] = at;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::RuntimeParams;
    use crate::response::Elasticity;
    use collision::{Shape, ShapeUnion, Solid, SolidPose};
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
    fn lengths_are_kept_whatever_they_were() {
        /// Lengths of up to 25 cm in single precision.
        const ROUND_OFF_CM: f32 = 2e-5;
        let (skin, mut x) = (strand(0.02), strand(-0.05));
        // Stretched as free flight and pushes leave it.
        for (k, v) in x.iter_mut().enumerate() {
            *v *= 1.0 + 0.05 * ((k % 5) as f32);
        }
        assert!(lengths(&x).iter().any(|l| (l - 1.0).abs() > 0.1));
        keep_lengths(&skin, &skin, &mut x, PAD, N);
        for (now, wanted) in lengths(&x).iter().zip(lengths(&skin)) {
            assert!((now - wanted).abs() < ROUND_OFF_CM, "{now} {wanted}");
        }
    }

    /// A coil about the y axis, a centimetre a segment, at rest.
    fn coil(radius: f32) -> Vec<f32> {
        let turn = 1.0;
        let rise = (1.0 - (2.0 * radius * (0.5f32 * turn).sin()).powi(2)).sqrt();
        let mut x = vec![0.0; 3 * PAD];
        for i in 0..PAD {
            let angle = turn * i as f32;
            x[i] = radius * angle.cos();
            x[PAD + i] = -rise * i as f32;
            x[2 * PAD + i] = radius * angle.sin();
        }
        x
    }

    #[test]
    fn a_coil_drawn_by_planes_keeps_lengths_and_planes_together() {
        let frames = [Frame::new(&Isometry3::identity())];
        let skin = coil(0.7);
        for pull in [0.1, 0.3, 0.6, 0.9] {
            // Planes that face down, as below a comb's teeth drawn down by that much.
            let touch = |segment: u16| {
                let [a, b, c] = point_at(&skin, PAD, usize::from(segment), 0.4);
                Touch { solid: 0, segment, s: 0.4, gap: 0.0, point: [a, b - pull, c], normal: [0.0, -1.0, 0.0] }
            };
            let mut touches = [touch(8), touch(15)];
            let mut x = skin.clone();
            lengths_and_planes(&mut touches, &frames, &skin, &skin, &mut x, PAD, N);
            for touch in &touches {
                let at = point_at(&x, PAD, usize::from(touch.segment), touch.s);
                assert!(plane_gap(touch, at) > -0.02, "{pull}: {}", plane_gap(touch, at));
            }
            for l in lengths(&x) {
                assert!((l - 1.0).abs() < 0.1, "{pull}: {l}");
            }
            assert_eq!(x[..N_FIXED], skin[..N_FIXED], "the scalp holds the root");
        }
    }

    #[test]
    fn putting_lengths_right_gives_no_velocity_whichever_way_is_taken() {
        /// Offsets of centimetres in single precision.
        const ROUND_OFF_CM: f32 = 1e-5;
        /// How far the coil has been drawn down, cm.
        const PULL: f32 = 0.6;
        let rod = Shape::capsule(Vector3::zeros(), Vector3::new(0.0, 0.0, 1.0), 0.1);
        let rod = ShapeUnion { shapes: vec![rod], smoothing: 0.0 };
        let rod = Solid::from_shape("rod", &rod, 0.05, 0.1, 0.3).unwrap();
        let solids = [SolidInHead::new(&rod, SolidPose::still(Isometry3::identity()))];
        let params = RuntimeParams::adaptive();
        let (solids, params) = (&solids[..], &params);
        let (dt, time, step, steps) = (0.01, 1.0, 7, 1);
        let (head, responses, length_cm) = (None, &[][..], 24.0);
        let around = Surroundings { dt, time, step, steps, solids, head, params, responses, length_cm, pad: PAD, n: N };
        let frames = [Frame::new(&Isometry3::identity())];
        let skin = coil(0.7);
        let mut drawn = skin.clone();
        for i in 0..PAD {
            drawn[PAD + i] -= PULL * (i as f32 / 8.0).min(1.0);
        }
        let touch = |segment: u16, below: f32| {
            let [a, b, c] = point_at(&drawn, PAD, usize::from(segment), 0.4);
            Touch { solid: 0, segment, s: 0.4, gap: 0.0, point: [a, b + below, c], normal: [0.0, -1.0, 0.0] }
        };
        // Planes that lengths put right from the root on leave alone, and planes that this takes the strand past.
        for (below, together) in [(2.0, false), (0.0, true)] {
            let mut touches = [touch(8, below), touch(15, below)];
            let mut alone = drawn.clone();
            keep_lengths(&skin, &skin, &mut alone, PAD, N);
            let offset: Vec<f32> = drawn.iter().zip(&skin).map(|(x, s)| x - s).collect();
            let mut work = Moving::default();
            (work.now, work.x, work.before, work.offset) = (skin.clone(), drawn.clone(), skin.clone(), offset.clone());
            keep_lengths_at_planes(&around, &mut touches, &frames, &skin, &mut work);
            for k in 0..3 * PAD {
                let (moved, at_start) = (work.x[k] - drawn[k], work.offset[k] - offset[k]);
                assert!((moved - at_start).abs() < ROUND_OFF_CM, "{k}: {moved} {at_start}");
            }
            assert!(work.x.iter().zip(&drawn).any(|(x, before)| (x - before).abs() > 0.1), "something moved");
            assert_eq!(work.x != alone, together);
            for l in lengths(&work.x) {
                assert!((l - 1.0).abs() < 0.1, "{l}");
            }
            for touch in &mut touches {
                let gap = |x: &[f32]| gap_where_it_passes(&mut touch.clone(), &frames[0], x, PAD, N);
                assert!(gap(&work.x) > -0.02, "{}", gap(&work.x));
                assert_eq!(gap(&alone) < -0.1, together);
            }
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
