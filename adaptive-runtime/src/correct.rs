//! Residual correction of one strand near solids: what guides alone cannot resolve (our own; docs/DEVIATIONS.md).
//!
//! Guides stand more than a centimetre apart and a comb's teeth a few millimetres, so a hair also carries an offset of its own from
//! the skinned strand. Unheld it returns as [`crate::offset`] says. A solid holds it off: at every place where the strand
//! was near a solid at the end of the last step it must not cross the plane that separated them, however far both move; then where the
//! strand has come to is looked at anew. A push is spread along the strand as [`crate::response`] says, segments keep their
//! lengths. The way that a plane takes it counts as velocity, so that the offset neither flickers nor snaps; what puts right where it is
//! (lengths, depth in a solid, the head) does not, for over a short substep it would fling it. Everything is in the head frame.

use crate::interpolate::{ActiveSet, MAX_PARTICLES, TransformArrays, interpolate};
use crate::kernels::{Carry, Settle, Sound, Turn, run};
use crate::look::{Look, Nearest, Particles, Sight};
use crate::offset::{N_FIXED, Return, farthest, fastest};
use crate::params::{Correction, RuntimeParams};
use crate::response::Response;
use crate::solid_in_head::{Frame, SolidInHead, particle};
use crate::strands::{Fade, GROUP, MAX_TOUCHES, Slot, Touch, Wake, bring_up, largest};
use multiversion::multiversion;
use nalgebra::Vector3;

/// Gaps up to this are remembered at least, so that a strand closing in stops at the surface and not behind it, cm.
const LEAST_WATCHED_CM: f32 = 0.1;

/// Multiple of a group's travel in one step within which strands are watched: motion grows little from step to step.
const WATCHED_TRAVEL: f32 = 1.5;

/// Greatest speed at which a strand leaves a solid along any axis, cm/s: what it had beyond is lost to the hair around it and to the air.
/// Returning by itself it then goes three quarters of a centimetre farther along it at most.
const RELEASE_SPEED: f32 = 10.0;

/// Gap below which a place bears on the strand, cm.
const BEARING_CM: f32 = 0.003;

/// Squares of the least and largest share of its rest length that a skinned segment may have and keep.
const LEAST_LENGTH2: f32 = 0.95 * 0.95;
const MOST_LENGTH2: f32 = 1.05 * 1.05;

/// Offsets longer than this are kept out of the head, cm: what lies on its guides lies outside it.
const HELD_CM: f32 = 0.05;

/// Most solids besides the head.
pub(crate) const MAX_SOLIDS: usize = 16;

/// Sweeps over the touches: those close together answer each other.
const SWEEPS: usize = 2;

/// What the correction of a step depends on.
pub(crate) struct Surroundings<'a> {
    pub dt: f64,
    /// Time at the end of the step, s.
    pub time: f64,
    /// Number of the step.
    pub step: u64,
    pub solids: &'a [SolidInHead<'a>],
    pub head: Option<&'a collision::Solid>,
    pub params: &'a RuntimeParams,
    /// For each number of substeps.
    pub responses: &'a [Response],
    /// Mean length of a strand, cm.
    pub length_cm: f32,
    pub pad: usize,
    pub n: usize,
}

/// One strand on its way through a step, three arrays of `pad` values each.
#[derive(Clone, Debug, Default)]
struct Moving {
    /// Skinned strand at the end of the step, and at its start where that is wanted.
    skin: Vec<f32>,
    old_skin: Vec<f32>,
    /// Skinned strand within the step.
    now: Vec<f32>,
    /// Where the strand is, offset included.
    x: Vec<f32>,
    offset: Vec<f32>,
    velocity: Vec<f32>,
    /// Whether the offset or its velocity may be other than zero.
    carries: bool,
    /// Whether a solid has moved it in this step.
    pushed: bool,
}

/// Buffers of one worker: a group of strands.
#[derive(Clone, Debug, Default)]
pub(crate) struct Work {
    strands: Vec<Moving>,
    /// Those looked at together: in the solid's frame, the length of the longest segment, and how far all but their touches surely is
    /// beyond the distance kept, cm.
    in_solid: Vec<f32>,
    longest: Vec<f32>,
    clear: Vec<f32>,
    look: Look,
}

impl Work {
    /// Room for `n` strands.
    fn fit(&mut self, n: usize, pad: usize) {
        if self.strands.len() < n {
            self.strands.resize_with(n, Moving::default);
            self.in_solid.resize(n * 3 * pad, 0.0);
            self.longest.resize(n, 0.0);
            self.clear.resize(n, 0.0);
        }
        for strand in &mut self.strands[..n] {
            let Moving { skin, old_skin, now, x, offset, velocity, .. } = strand;
            for buffer in [skin, old_skin, now, x, offset, velocity] {
                buffer.resize(3 * pad, 0.0);
            }
        }
    }
}

/// A solid's hold on a strand: how far it keeps it from its guides there, along the normal.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hold {
    pub strand: u32,
    pub segment: u16,
    pub s: f32,
    /// cm, head frame.
    pub held: [f32; 3],
}

/// What became of one strand.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// Out of reach.
    #[default]
    Away,
    /// Watched, not pushed.
    Near,
    /// Pushed by a solid.
    Pushed,
    /// Its state was not finite and has been cleared.
    Lost,
}

/// What strands are skinned from.
#[derive(Clone, Copy)]
pub(crate) struct Skins<'a> {
    pub rest: &'a [f32],
    pub u: &'a [f32],
    pub active: &'a [ActiveSet],
    pub transforms: &'a TransformArrays,
    /// At the start of the step.
    pub before: &'a TransformArrays,
    pub pad: usize,
}

impl Skins<'_> {
    fn rest_of(&self, strand: usize) -> &[f32] {
        &self.rest[strand * 3 * self.pad..(strand + 1) * 3 * self.pad]
    }

    fn at_start(&self, strand: usize, out: &mut [f32]) {
        interpolate(self.rest_of(strand), self.u, &self.active[strand], self.before, out);
    }

    fn at_end(&self, strand: usize, out: &mut [f32]) {
        interpolate(self.rest_of(strand), self.u, &self.active[strand], self.transforms, out);
    }
}

/// How a group moved.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Travel {
    /// Since the runtime was made, and in this step, cm.
    pub total: f64,
    pub last: f32,
}

/// What the runtime keeps of the strands of a group.
pub(crate) struct Members<'a> {
    pub slots: &'a mut [Slot],
    pub wakes: &'a mut [Wake],
    pub fades: &'a mut [Fade],
    /// Offset, then velocity of each, three arrays of `pad` values each.
    pub carried: &'a mut [f32],
}

/// Takes the strands of a group that are `awake` (indices within the group) through a step among solids. What holds them goes to
/// `holds`, what became of each to `outcome`.
pub(crate) fn correct(
    around: &Surroundings,
    skins: &Skins,
    members: &mut Members,
    awake: &[u8],
    travel: Travel,
    work: &mut Work,
    holds: &mut Vec<Hold>,
    outcome: &mut impl FnMut(Outcome),
) {
    let Surroundings { pad, params, .. } = *around;
    let residual = &params.residual;
    let rate = residual.return_rate;
    let began = around.time - around.dt;
    work.fit(awake.len(), pad);
    for (w, &k) in work.strands.iter_mut().zip(awake) {
        let k = usize::from(k);
        let (slot, fade) = (&mut members.slots[k], &mut members.fades[k]);
        skins.at_end(slot.strand as usize, &mut w.skin);
        if residual.correction == Correction::Position {
            // What it moved is not carried on.
            *fade = Fade::NONE;
        }
        (w.carries, w.pushed) = (fade.carries(began), false);
        if w.carries {
            let (offset, velocity) = members.carried[k * 6 * pad..(k + 1) * 6 * pad].split_at(3 * pad);
            w.offset.copy_from_slice(offset);
            w.velocity.copy_from_slice(velocity);
        }
        bring_up(fade, &mut w.offset, &mut w.velocity, began, rate);
        // Planes older than a step say nothing of what has slipped past them since; a strand sleeps only where it can meet nothing for
        // longer.
        if slot.looked.wrapping_add(1) != around.step {
            slot.n_touches = 0;
        }
    }
    let reach = params.guides.contact.offset_cm as f32 + LEAST_WATCHED_CM.max(WATCHED_TRAVEL * travel.last);
    if residual.correction != Correction::Carried {
        correct_at_end(around, members, awake, travel, reach, work, holds, outcome);
        return;
    }
    let thinnest = around.solids.iter().map(|s| s.solid.half_thickness_cm).fold(f32::INFINITY, f32::min);
    let wanted = (travel.last / (residual.motion_per_substep as f32 * thinnest)).ceil();
    // A travel that is not finite must not become a count.
    let substeps = if wanted.is_finite() { (wanted as usize).clamp(1, residual.max_substeps) } else { 1 };
    if substeps > 1 {
        for (w, &k) in work.strands.iter_mut().zip(awake) {
            skins.at_start(members.slots[usize::from(k)].strand as usize, &mut w.old_skin);
        }
    }
    let h = around.dt / substeps as f64;
    let back = Return::over(h, rate);
    let response = &around.responses[substeps - 1];
    for substep in 1..=substeps {
        let alpha = substep as f32 / substeps as f32;
        for (w, &k) in work.strands.iter_mut().zip(awake) {
            let slot = &mut members.slots[usize::from(k)];
            if substep == substeps {
                w.now.copy_from_slice(&w.skin);
            } else {
                between(&w.old_skin, &w.skin, alpha, &mut w.now);
            }
            if !w.carries {
                w.x.copy_from_slice(&w.now);
            } else if slot.n_touches > 0 {
                response.advance(&w.now, &w.offset, &w.velocity, &mut w.x);
            } else {
                run(Carry { skin: &w.now, offset: &w.offset, velocity: &w.velocity, back, x: &mut w.x });
            }
            // Over parts of a step what slides is not known well enough to be slowed.
            let friction = (substeps == 1).then_some(skins);
            if hold_at_planes(around, response, slot, alpha, friction, w) {
                let rest = skins.rest_of(slot.strand as usize);
                keep_lengths(&w.now, rest, &mut w.x, &mut w.offset, pad, around.n);
                w.pushed = true;
            }
        }
        look(around, members.slots, awake, alpha, reach, work);
        for (w, &k) in work.strands.iter_mut().zip(awake) {
            let slot = &mut members.slots[usize::from(k)];
            w.pushed |= move_out(around, response, slot, alpha, (travel.last / substeps as f32, h as f32), w);
            if substep == substeps && w.pushed {
                keep_out_of_head(around, response, w);
            }
            w.carries |= w.pushed;
            if !w.carries {
                continue;
            }
            run(Settle {
                x: &w.x,
                skin: &w.now,
                inv_h: 1.0 / h as f32,
                max_speed: residual.max_speed as f32,
                offset: &mut w.offset,
                velocity: &mut w.velocity,
            });
        }
    }
    for ((w, &clear), &k) in work.strands.iter_mut().zip(&work.clear).zip(awake) {
        let k = usize::from(k);
        let carried = &mut members.carried[k * 6 * pad..(k + 1) * 6 * pad];
        let (slot, wake, fade) = (&mut members.slots[k], &mut members.wakes[k], &mut members.fades[k]);
        outcome(leave(around, slot, wake, fade, carried, travel, clear, w, holds));
    }
}

/// Writes back what a strand carries at the end of a step, says what holds it, and lets it sleep as long as it can.
fn leave(
    around: &Surroundings,
    slot: &mut Slot,
    wake: &mut Wake,
    fade: &mut Fade,
    carried: &mut [f32],
    travel: Travel,
    clear: f32,
    w: &mut Moving,
    holds: &mut Vec<Hold>,
) -> Outcome {
    let Surroundings { pad, params, .. } = *around;
    let residual = &params.residual;
    let rate = residual.return_rate;
    let (offset, velocity) = carried.split_at_mut(3 * pad);
    let (mut size, mut speed) = (0.0, 0.0);
    if w.carries {
        if slot.n_touches == 0 {
            for v in &mut w.velocity {
                *v = v.clamp(-RELEASE_SPEED, RELEASE_SPEED);
            }
        }
        (size, speed) = (largest(&w.offset, pad), largest(&w.velocity, pad));
        offset.copy_from_slice(&w.offset);
        velocity.copy_from_slice(&w.velocity);
        *fade = Fade::of(offset, velocity, pad, around.time, rate, residual.rest_cm);
        // Nothing holds a strand farther off its place than it is long.
        let too_far = size > around.length_cm;
        if too_far || !(run(Sound(offset)) && run(Sound(velocity)) && run(Sound(&w.x))) {
            offset.fill(0.0);
            velocity.fill(0.0);
            slot.n_touches = 0;
            *wake = Wake::NOW;
            *fade = Fade::NONE;
            return Outcome::Lost;
        }
    }
    slot.looked = around.step;
    let (mut least, mut bears) = (clear, false);
    for touch in &mut slot.touches[..usize::from(slot.n_touches)] {
        let solid = &around.solids[usize::from(touch.solid)];
        let (j, s) = (usize::from(touch.segment), touch.s);
        // Where pushes have brought it since it was looked at.
        let point = solid.at_end.point(point_at(&w.x, pad, j, s));
        let gap = plane_gap(touch, point);
        (touch.gap, touch.point) = (gap, point);
        least = least.min(gap);
        if gap < BEARING_CM {
            let normal = solid.at_end.vector_back(touch.normal);
            let at = dot(normal, point_at(&w.offset, pad, j, s));
            if at > 0.0 {
                bears = true;
                holds.push(Hold { strand: slot.strand, segment: touch.segment, s, held: scaled(normal, at) });
            }
        }
    }
    let gap = f64::from(least - WATCHED_TRAVEL * travel.last).max(0.0);
    *wake = Wake::after(gap, travel.total, around.time, farthest(size, speed, rate), fastest(size, speed, rate));
    match (bears, slot.n_touches) {
        (true, _) => Outcome::Pushed,
        (false, 0) => Outcome::Away,
        (false, _) => Outcome::Near,
    }
}

/// What is compared with: nothing but the force that AS16 §5.1 puts on a strand in a solid, or its particles moved out
/// one by one at the end of the step (Chai 2014), which the next step knows nothing of.
fn correct_at_end(
    around: &Surroundings,
    members: &mut Members,
    awake: &[u8],
    travel: Travel,
    reach: f32,
    work: &mut Work,
    holds: &mut Vec<Hold>,
    outcome: &mut impl FnMut(Outcome),
) {
    let pad = around.pad;
    let back = Return::over(around.dt, around.params.residual.return_rate);
    for w in &mut work.strands[..awake.len()] {
        run(Carry { skin: &w.skin, offset: &w.offset, velocity: &w.velocity, back, x: &mut w.x });
    }
    look(around, members.slots, awake, 1.0, reach, work);
    let gap_kept = around.params.guides.contact.offset_cm as f32;
    for ((w, &clear), &k) in work.strands.iter_mut().zip(&work.clear).zip(awake) {
        let k = usize::from(k);
        let slot = &mut members.slots[k];
        members.wakes[k] = Wake { at: travel.total, from: f64::INFINITY };
        if slot.n_touches == 0 {
            members.wakes[k].at += f64::from(clear);
            outcome(Outcome::Away);
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
        outcome(if inside { Outcome::Pushed } else { Outcome::Near });
    }
}

#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn between(a: &[f32], b: &[f32], alpha: f32, out: &mut [f32]) {
    for i in 0..out.len().min(a.len()).min(b.len()) {
        out[i] = a[i] + (b[i] - a[i]) * alpha;
    }
}

/// Length of the longest segment, cm.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn longest_segment(x: &[f32], pad: usize, n: usize) -> f32 {
    let (x, rest) = x.split_at(pad);
    let (y, z) = rest.split_at(pad);
    let mut most = 0.0f32;
    for i in 0..n - 1 {
        let d = [x[i + 1] - x[i], y[i + 1] - y[i], z[i + 1] - z[i]];
        let length2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        most = if length2 > most { length2 } else { most };
    }
    most.sqrt()
}

#[inline(always)]
fn point_at(x: &[f32], pad: usize, segment: usize, s: f32) -> [f32; 3] {
    let at = |i: usize| x[i] + (x[i + 1] - x[i]) * s;
    [at(segment), at(pad + segment), at(2 * pad + segment)]
}

#[inline(always)]
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn less(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
fn scaled(a: [f32; 3], s: f32) -> [f32; 3] {
    [a[0] * s, a[1] * s, a[2] * s]
}

/// Gap of a point (solid's frame) to the plane of a touch, less the distance kept, cm.
#[inline(always)]
fn plane_gap(touch: &Touch, point: [f32; 3]) -> f32 {
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

/// Keeps the strand on its side of the plane of every touch, where it passes, and no deeper behind one than it was; returns whether it
/// had to.
fn hold_at_planes(
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
            let y = pass(touch, frame, &work.x, pad, n);
            // What was in the solid before is let out once it is looked at.
            let gap = plane_gap(touch, y) - touch.gap.min(0.0);
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

/// Looks at strands where they now are: what is nearer than the reach becomes their touches, and `work.clear` how far all else
/// surely is beyond the distance kept, cm.
fn look(around: &Surroundings, slots: &mut [Slot], awake: &[u8], alpha: f32, reach: f32, work: &mut Work) {
    let Surroundings { pad, n, .. } = *around;
    let gap_kept = around.params.guides.contact.offset_cm as f32;
    let count = awake.len();
    for (i, &k) in awake.iter().enumerate() {
        slots[usize::from(k)].n_touches = 0;
        work.longest[i] = longest_segment(&work.strands[i].x, pad, n);
    }
    let Work { strands, in_solid, longest, clear, look, .. } = work;
    let (longest, clear) = (&longest[..count], &mut clear[..count]);
    clear.fill(f32::INFINITY);
    let spacing = around.params.guides.contact.spacing_over_half_thickness as f32;
    for (number, solid) in around.solids.iter().enumerate() {
        let frame = solid.at(f64::from(alpha));
        for (w, out) in strands.iter().zip(in_solid.chunks_exact_mut(3 * pad)).take(count) {
            run(Turn { frame: &frame, x: &w.x, out });
        }
        let sight = Sight {
            field: &solid.solid.sdf,
            first: N_FIXED - 1,
            end: n,
            reach,
            spacing: solid.solid.half_thickness_cm * spacing,
        };
        // The least of all are kept; the others bound what is not remembered.
        let mut left_out = [f32::INFINITY; GROUP];
        look.along(&sight, Particles { x: in_solid, pad }, longest, clear, &mut |i, near| {
            let slot = &mut slots[usize::from(awake[i])];
            let Nearest { segment, s, distance, point, normal } = near;
            let gap = distance - gap_kept;
            let touch = Touch { solid: number as u16, segment, s, gap, point, normal };
            let held = usize::from(slot.n_touches);
            if held < MAX_TOUCHES {
                slot.touches[held] = touch;
                slot.n_touches += 1;
                return;
            }
            let most = (0..held).fold(0, |m, i| if slot.touches[i].gap > slot.touches[m].gap { i } else { m });
            left_out[i] = left_out[i].min(gap_kept + gap.max(slot.touches[most].gap));
            if gap < slot.touches[most].gap {
                slot.touches[most] = touch;
            }
        });
        for (clear, left_out) in clear.iter_mut().zip(left_out) {
            *clear = clear.min(left_out);
        }
    }
    for clear in clear {
        *clear -= gap_kept;
    }
}

/// Moves the strand out of solids at its touches, just looked at, by at most what strand and solid move (`travel`, cm, and as fast as
/// pushes may be over `h`, s); returns whether it had to.
fn move_out(
    around: &Surroundings,
    response: &Response,
    slot: &mut Slot,
    alpha: f32,
    (travel, h): (f32, f32),
    work: &mut Moving,
) -> bool {
    let pad = around.pad;
    let most = around.params.guides.contact.max_push_speed as f32 * h + travel;
    let mut pushed = false;
    for touch in &mut slot.touches[..usize::from(slot.n_touches)] {
        let frame = around.solids[usize::from(touch.solid)].at(f64::from(alpha));
        let (j, s) = (usize::from(touch.segment), touch.s);
        // Earlier pushes may have moved it out already.
        let gap = plane_gap(touch, frame.point(point_at(&work.x, pad, j, s)));
        if gap < 0.0 {
            let by = frame.vector_back(scaled(touch.normal, (-gap).min(most)));
            put_right(response, (j, s), by, work);
            pushed = true;
        }
    }
    pushed
}

/// Moves the strand at one place, and its offset at the start with it: that adds nothing to its velocity.
fn put_right(response: &Response, (segment, s): (usize, f32), by: [f32; 3], work: &mut Moving) {
    response.push_at(segment, s, by, &mut work.x);
    response.push_at(segment, s, by, &mut work.offset);
}

/// Moves particles that are held off their place out of the head.
fn keep_out_of_head(around: &Surroundings, response: &Response, work: &mut Moving) {
    let Some(head) = around.head else { return };
    let pad = around.pad;
    let gap_kept = around.params.guides.contact.offset_cm as f32;
    for i in N_FIXED..around.n {
        let (p, s) = (particle(&work.x, pad, i), particle(&work.now, pad, i));
        let d = less(p, s);
        if dot(d, d) < HELD_CM * HELD_CM || head.sdf.distance(Vector3::from(p)) >= gap_kept {
            continue;
        }
        let (distance, normal) = head.sdf.outward_normal(Vector3::from(p));
        // Hair that its guides have nearer than that is not moved out farther than they have it.
        let kept = gap_kept.min(head.sdf.distance(Vector3::from(s)));
        if distance < kept {
            let by = normal * (kept - distance);
            put_right(response, (i - 1, 1.0), by.into(), work);
        }
    }
}

/// Gives every segment the length that it has on the skinned strand, or nearly that at rest, directions kept; the offset at the start goes
/// with it, so that nothing of that counts as velocity.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn keep_lengths(skin: &[f32], rest: &[f32], x: &mut [f32], offset: &mut [f32], pad: usize, n: usize) {
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
mod tests;
