//! Residual correction of one strand near solids: what guides alone cannot resolve (our own; docs/DEVIATIONS.md).
//!
//! Guides stand more than a centimetre apart and a comb's teeth a few millimetres, so a hair also carries an offset of its own from
//! the skinned strand. Unheld it returns as [`crate::offset`] says. A solid holds it off: at every place where the strand
//! was near a solid at the end of the last step it must not cross the plane that separated them, however far both move; then where the
//! strand has come to is looked at anew. A push is spread along the strand as [`crate::response`] says, segments keep their
//! lengths. The way that a plane takes it counts as velocity, so that the offset neither flickers nor snaps; what puts right where it is
//! (lengths, depth in a solid, the head) does not, for over a short substep it would fling it. Everything is in the head frame.

use crate::interpolate::{ActiveSet, TransformArrays, interpolate};
use crate::kernels::{Carry, Settle, Sound, Turn, run};
use crate::look::{Look, Nearest, Particles, Sight};
use crate::offset::{N_FIXED, Return, farthest, fastest};
use crate::params::{Correction, RuntimeParams};
use crate::planes::{dot, hold_at_planes, keep_lengths_at_planes, plane_gap, point_at, scaled};
use crate::response::Response;
use crate::solid_in_head::{Frame, SolidInHead};
use crate::strands::{Fade, GROUP, MAX_TOUCHES, Slot, Touch, Wake, bring_up, largest};
use arrayvec::ArrayVec;
use multiversion::multiversion;
use out_of_head::keep_out_of_head;

mod at_end;
mod out_of_head;

/// Gaps up to this are remembered at least, so that a strand closing in stops at the surface and not behind it, cm.
const LEAST_WATCHED_CM: f32 = 0.1;

/// Multiple of a group's travel in one step within which strands are watched: motion grows little from step to step.
const WATCHED_TRAVEL: f32 = 1.2;

/// Greatest speed at which a strand leaves a solid along any axis, cm/s: what it had beyond is lost to the hair around it and to the air.
/// Returning by itself it then goes three quarters of a centimetre farther along it at most.
const RELEASE_SPEED: f32 = 10.0;

/// Looks at a strand in a substep at most, and how far it must have been moved out of a solid to be looked at again (cm): its other parts
/// may then be in another.
const LOOKS: usize = 8;
const LOOK_AGAIN_CM: f32 = 0.005;

/// Gap below which a place bears on a strand that nothing has moved in this step, and on one that has been moved, cm: lengths put right leave it a little off the
/// plane that holds it.
const BEARING_CM: f32 = 0.003;
const BEARING_PUSHED_CM: f32 = 0.03;

/// Most solids besides the head.
pub(crate) const MAX_SOLIDS: usize = 16;

/// What the correction of a step depends on.
pub(crate) struct Surroundings<'a> {
    /// Time since the strands were met last, s.
    pub dt: f64,
    /// Time at the end of the step, s.
    pub time: f64,
    /// Number of the step, and of steps since the strands were met last, this one included.
    pub step: u64,
    pub steps: u64,
    /// Over that time.
    pub solids: &'a [SolidInHead<'a>],
    pub head: Option<&'a collision::Solid>,
    pub params: &'a RuntimeParams,
    /// For each number of substeps of that time.
    pub responses: &'a [Response],
    /// Mean length of a strand, cm.
    pub length_cm: f32,
    pub pad: usize,
    pub n: usize,
}

/// One strand on its way through a step, three arrays of `pad` values each.
#[derive(Clone, Debug, Default)]
pub(crate) struct Moving {
    /// Skinned strand at the end of the step, and when it was met last where that is wanted.
    skin: Vec<f32>,
    pub old_skin: Vec<f32>,
    /// Skinned strand within the step.
    pub now: Vec<f32>,
    /// Where the strand is, offset included, and where it was before its lengths were put right.
    pub x: Vec<f32>,
    pub before: Vec<f32>,
    pub offset: Vec<f32>,
    velocity: Vec<f32>,
    /// Places where it was held off solids in this substep.
    held: ArrayVec<Touch, MAX_TOUCHES>,
    /// Whether the offset or its velocity may be other than zero.
    carries: bool,
    /// Whether a solid has moved it in this step.
    pushed: bool,
}

/// Buffers of one worker: a group of strands.
#[derive(Clone, Debug, Default)]
pub(crate) struct Work {
    strands: Vec<Moving>,
    /// Those looked at together in the solid's frame, and of each how far all but their touches surely is
    /// beyond the distance kept, cm.
    in_solid: Vec<f32>,
    clear: Vec<f32>,
    look: Look,
}

impl Work {
    /// Room for `n` strands.
    fn fit(&mut self, n: usize, pad: usize) {
        if self.strands.len() < n {
            self.strands.resize_with(n, Moving::default);
            self.in_solid.resize(n * 3 * pad, 0.0);
            self.clear.resize(n, 0.0);
        }
        for strand in &mut self.strands[..n] {
            let Moving { skin, old_skin, now, x, before, offset, velocity, .. } = strand;
            for buffer in [skin, old_skin, now, x, before, offset, velocity] {
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
    /// When the strands were met last.
    pub before: &'a TransformArrays,
    pub pad: usize,
}

impl Skins<'_> {
    fn rest_of(&self, strand: usize) -> &[f32] {
        &self.rest[strand * 3 * self.pad..(strand + 1) * 3 * self.pad]
    }

    pub(crate) fn at_start(&self, strand: usize, out: &mut [f32]) {
        interpolate(self.rest_of(strand), self.u, &self.active[strand], self.before, out);
    }

    fn at_end(&self, strand: usize, out: &mut [f32]) {
        interpolate(self.rest_of(strand), self.u, &self.active[strand], self.transforms, out);
    }
}

/// How a group moved.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Travel {
    /// Since the runtime was made, and since it was met last, cm.
    pub total: f64,
    pub last: f32,
    /// What it moves until it is met again if it goes on so, cm.
    pub next: f32,
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
/// `holds`, what became of each, and how deep it is left in a solid (cm), to `outcome`.
pub(crate) fn correct(
    around: &Surroundings,
    skins: &Skins,
    members: &mut Members,
    awake: &[u8],
    travel: Travel,
    work: &mut Work,
    holds: &mut Vec<Hold>,
    outcome: &mut impl FnMut(Outcome, f32),
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
        // Planes older than the last meeting say nothing of what has slipped past them since; a strand sleeps only where it can meet nothing for
        // longer.
        if slot.looked.wrapping_add(around.steps) != around.step {
            slot.n_touches = 0;
        }
    }
    let reach = params.guides.contact.offset_cm as f32 + LEAST_WATCHED_CM.max(WATCHED_TRAVEL * travel.next);
    if residual.correction != Correction::Carried {
        at_end::correct_at_end(around, members, awake, travel, reach, work, holds, outcome);
        return;
    }
    let thinnest = around.solids.iter().map(|s| s.solid.half_thickness_cm).fold(f32::INFINITY, f32::min);
    let wanted = (travel.last / (residual.motion_per_substep as f32 * thinnest)).ceil();
    // A travel that is not finite must not become a count.
    let substeps = if around.steps > 1 {
        1
    } else if wanted.is_finite() {
        (wanted as usize).clamp(1, residual.max_substeps)
    } else {
        1
    };
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
        let frames: ArrayVec<Frame, MAX_SOLIDS> =
            around.solids.iter().map(|solid| solid.at(f64::from(alpha))).collect();
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
            let (strand, touches) = (slot.strand as usize, &mut slot.touches[..usize::from(slot.n_touches)]);
            // Over parts of a step what slides is not known well enough to be slowed.
            let friction = (substeps == 1).then_some((skins, strand));
            if hold_at_planes(around, response, touches, &frames, friction, w) {
                keep_lengths_at_planes(around, touches, &frames, skins.rest_of(strand), w);
                w.pushed = true;
            }
            w.held.clear();
            w.held.extend(touches.iter().copied());
        }
        let most = params.guides.contact.max_push_speed as f32 * h as f32 + travel.last / substeps as f32;
        let mut which = all(awake.len());
        for look_number in 1..=LOOKS {
            look(around, members.slots, awake, &which, &frames, reach, work);
            which.retain(|i| {
                let (w, slot) =
                    (&mut work.strands[usize::from(*i)], &mut members.slots[usize::from(awake[usize::from(*i)])]);
                let moved = move_out(around, response, slot, &frames, most, w);
                w.pushed |= moved > 0.0;
                let again = moved > LOOK_AGAIN_CM && look_number < LOOKS;
                if again {
                    let mut held = w.held.clone();
                    keep_lengths_at_planes(around, &mut held, &frames, skins.rest_of(slot.strand as usize), w);
                }
                again
            });
            if which.is_empty() {
                break;
            }
        }
        for w in &mut work.strands[..awake.len()] {
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
        let (what, depth) = leave(around, slot, wake, fade, carried, travel, clear, w, holds);
        outcome(what, depth);
    }
}

/// Writes back what a strand carries at the end of a step, says what holds it, and lets it sleep as long as it can; returns what became of
/// it and how deep it is left in a solid, cm.
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
) -> (Outcome, f32) {
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
            return (Outcome::Lost, 0.0);
        }
    }
    slot.looked = around.step;
    let (mut least, mut bears) = (clear, false);
    let bearing = if w.pushed { BEARING_PUSHED_CM } else { BEARING_CM };
    for touch in &mut slot.touches[..usize::from(slot.n_touches)] {
        let solid = &around.solids[usize::from(touch.solid)];
        let (j, s) = (usize::from(touch.segment), touch.s);
        // Where pushes have brought it since it was looked at.
        let point = solid.at_end.point(point_at(&w.x, pad, j, s));
        let gap = plane_gap(touch, point);
        (touch.gap, touch.point) = (gap, point);
        least = least.min(gap);
        if gap < bearing {
            let normal = solid.at_end.vector_back(touch.normal);
            let at = dot(normal, point_at(&w.offset, pad, j, s));
            if at > 0.0 {
                bears = true;
                holds.push(Hold { strand: slot.strand, segment: touch.segment, s, held: scaled(normal, at) });
            }
        }
    }
    let gap = f64::from(least - WATCHED_TRAVEL * travel.next).max(0.0);
    *wake = Wake::after(gap, travel.total, around.time, farthest(size, speed, rate), fastest(size, speed, rate));
    let outcome = match (bears, slot.n_touches) {
        (true, _) => Outcome::Pushed,
        (false, 0) => Outcome::Away,
        (false, _) => Outcome::Near,
    };
    (outcome, -(least + params.guides.contact.offset_cm as f32))
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

/// The first `n` strands of a group.
fn all(n: usize) -> ArrayVec<u8, GROUP> {
    (0..n as u8).collect()
}

/// Looks at strands where they now are, those of `awake` whose numbers are in `which`: what is nearer than the reach becomes their
/// touches, and `work.clear` how far all else surely is beyond the distance kept, cm.
fn look(
    around: &Surroundings,
    slots: &mut [Slot],
    awake: &[u8],
    which: &[u8],
    frames: &[Frame],
    reach: f32,
    work: &mut Work,
) {
    let Surroundings { pad, n, .. } = *around;
    let gap_kept = around.params.guides.contact.offset_cm as f32;
    let Work { strands, in_solid, clear: kept_clear, look, .. } = work;
    let (mut longest, mut clear) = ([0.0f32; GROUP], [f32::INFINITY; GROUP]);
    for (&i, longest) in which.iter().zip(&mut longest) {
        slots[usize::from(awake[usize::from(i)])].n_touches = 0;
        *longest = longest_segment(&strands[usize::from(i)].x, pad, n);
    }
    let (longest, clear) = (&longest[..which.len()], &mut clear[..which.len()]);
    let spacing = around.params.guides.contact.spacing_over_half_thickness as f32;
    for (number, solid) in around.solids.iter().enumerate() {
        let frame = &frames[number];
        for (&i, out) in which.iter().zip(in_solid.chunks_exact_mut(3 * pad)) {
            run(Turn { frame, x: &strands[usize::from(i)].x, out });
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
            let slot = &mut slots[usize::from(awake[usize::from(which[i])])];
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
    for (&i, clear) in which.iter().zip(clear) {
        kept_clear[usize::from(i)] = *clear - gap_kept;
    }
}

/// Moves the strand out of solids at its touches, just looked at, by at most `most` (cm) each; returns the farthest that it had to, cm.
fn move_out(
    around: &Surroundings,
    response: &Response,
    slot: &mut Slot,
    frames: &[Frame],
    most: f32,
    work: &mut Moving,
) -> f32 {
    let pad = around.pad;
    let mut farthest = 0.0f32;
    for touch in &mut slot.touches[..usize::from(slot.n_touches)] {
        let frame = &frames[usize::from(touch.solid)];
        let (j, s) = (usize::from(touch.segment), touch.s);
        // Earlier pushes may have moved it out already.
        let gap = plane_gap(touch, frame.point(point_at(&work.x, pad, j, s)));
        if gap < 0.0 {
            let by = (-gap).min(most);
            put_right(response, (j, s), frame.vector_back(scaled(touch.normal, by)), work);
            farthest = farthest.max(by);
        }
    }
    farthest
}

/// Moves the strand at one place, and its offset at the start with it: that adds nothing to its velocity.
fn put_right(response: &Response, (segment, s): (usize, f32), by: [f32; 3], work: &mut Moving) {
    response.push_at(segment, s, by, &mut work.x);
    response.push_at(segment, s, by, &mut work.offset);
}
