//! Residual correction of one strand near solids: what guides alone cannot resolve (our own; docs/DEVIATIONS.md).
//!
//! Guides stand more than a centimetre apart and a comb's teeth a few millimetres, so a hair also carries an offset of its own from
//! the skinned strand. Unheld it returns as [`crate::offset`] says. A solid holds it off: at every place where the strand
//! was near a solid at the end of the last step it must not cross the plane that separated them, however far both move; then where the
//! strand has come to is looked at anew. A push is spread along the strand as [`crate::response`] says, segments keep their
//! lengths. The way that a plane takes it counts as velocity, so that the offset neither flickers nor snaps; what puts right where it is
//! (lengths, depth in a solid, the head) does not, for over a short substep it would fling it. Everything is in the head frame.

use crate::interpolate::MAX_PARTICLES;
use crate::kernels::{Carry, Settle, Sound, run};
use crate::look::{Look, Particles, Sight};
use crate::offset::{N_FIXED, Return, farthest, fastest};
use crate::params::{Correction, RuntimeParams};
use crate::response::Response;
use crate::solid_in_head::{Frame, SolidInHead, particle};
use crate::strands::{Fade, MAX_TOUCHES, Slot, Touch, bring_up, largest};
use multiversion::multiversion;
use nalgebra::Vector3;

/// Gaps up to this are remembered at least, so that a strand closing in stops at the surface and not behind it, cm.
const LEAST_WATCHED_CM: f32 = 0.1;

/// Multiple of a group's travel in one step within which strands are watched: motion grows little from step to step.
const WATCHED_TRAVEL: f32 = 1.5;

/// By how much more than the reach segments are marked as near, cm: so long they stay the only ones.
const MARKED_CM: f32 = 0.5;

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

/// Buffers of one worker, three arrays of `pad` values each.
#[derive(Clone, Debug, Default)]
pub(crate) struct Work {
    /// Skinned strand at the end of the step, and at its start where that is wanted.
    pub skin: Vec<f32>,
    pub old_skin: Vec<f32>,
    /// Skinned strand within the step.
    now: Vec<f32>,
    /// Where the strand is, offset included.
    x: Vec<f32>,
    offset: Vec<f32>,
    velocity: Vec<f32>,
    look: Look,
}

impl Work {
    pub(crate) fn resize(&mut self, pad: usize) {
        for buffer in
            [&mut self.skin, &mut self.old_skin, &mut self.now, &mut self.x, &mut self.offset, &mut self.velocity]
        {
            buffer.resize(3 * pad, 0.0);
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

/// Writes a strand as it was skinned at the start of the step.
type SkinAtStart<'a> = dyn Fn(&mut [f32]) + 'a;

/// A strand's place in its group and how the group moved.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Travel {
    /// Since the runtime was made, and in this step, cm.
    pub total: f64,
    pub last: f32,
}

/// Takes one strand through a step among solids: `work.skin` holds it skinned at the end; `carried` its offset and velocity;
/// `skin_at_start` gives it skinned at the start, for strands that move far.
pub(crate) fn correct(
    around: &Surroundings,
    slot: &mut Slot,
    fade: &mut Fade,
    rest: &[f32],
    carried: &mut [f32],
    travel: Travel,
    work: &mut Work,
    skin_at_start: impl Fn(&mut [f32]),
    holds: &mut Vec<Hold>,
) -> Outcome {
    let Surroundings { pad, n, params, .. } = *around;
    let residual = &params.residual;
    let rate = residual.return_rate;
    let began = around.time - around.dt;
    let (offset, velocity) = carried.split_at_mut(3 * pad);
    work.offset.copy_from_slice(offset);
    work.velocity.copy_from_slice(velocity);
    if residual.correction == Correction::Position {
        // What it moved is not carried on.
        *fade = Fade::NONE;
    }
    bring_up(fade, &mut work.offset, &mut work.velocity, began, rate);
    let whole = Return::over(around.dt, rate);
    run(Carry { skin: &work.skin, offset: &work.offset, velocity: &work.velocity, back: whole, x: &mut work.x });
    let reach = params.guides.contact.offset_cm as f32 + LEAST_WATCHED_CM.max(WATCHED_TRAVEL * travel.last);
    if residual.correction != Correction::Carried {
        return correct_at_end(around, slot, fade, carried, travel, reach, work, holds);
    }
    // Planes older than a step say nothing of what has slipped past them since; a strand sleeps only where it can meet nothing for longer.
    if slot.looked.wrapping_add(1) != around.step {
        slot.n_touches = 0;
    }
    let thinnest = around.solids.iter().map(|s| s.solid.half_thickness_cm).fold(f32::INFINITY, f32::min);
    let wanted = (travel.last / (residual.motion_per_substep as f32 * thinnest)).ceil();
    // A travel that is not finite must not become a count.
    let substeps = if wanted.is_finite() { (wanted as usize).clamp(1, residual.max_substeps) } else { 1 };
    if substeps > 1 {
        skin_at_start(&mut work.old_skin);
    }
    let h = around.dt / substeps as f64;
    let back = Return::over(h, rate);
    let response = &around.responses[substeps - 1];
    let (mut pushed, mut clear) = (false, f32::INFINITY);
    for k in 1..=substeps {
        let alpha = k as f32 / substeps as f32;
        if k == substeps {
            work.now.copy_from_slice(&work.skin);
        } else {
            between(&work.old_skin, &work.skin, alpha, &mut work.now);
        }
        if slot.n_touches > 0 {
            response.advance(&work.now, &work.offset, &work.velocity, &mut work.x);
        } else {
            run(Carry { skin: &work.now, offset: &work.offset, velocity: &work.velocity, back, x: &mut work.x });
        }
        // Over parts of a step what slides is not known well enough to be slowed.
        let friction = (substeps == 1).then_some(&skin_at_start as &SkinAtStart);
        let held = hold_at_planes(around, response, slot, alpha, friction, work);
        if held {
            keep_lengths(&work.now, rest, &mut work.x, &mut work.offset, pad, n);
        }
        clear = look(around, slot, alpha, travel, reach, work);
        pushed |= held | move_out(around, response, slot, alpha, (travel.last / substeps as f32, h as f32), work);
        if k == substeps && pushed {
            keep_out_of_head(around, response, work);
        }
        run(Settle {
            x: &work.x,
            skin: &work.now,
            inv_h: 1.0 / h as f32,
            max_speed: residual.max_speed as f32,
            offset: &mut work.offset,
            velocity: &mut work.velocity,
        });
    }
    if slot.n_touches == 0 {
        for v in &mut work.velocity {
            *v = v.clamp(-RELEASE_SPEED, RELEASE_SPEED);
        }
    }
    if pushed || fade.carries(began) {
        offset.copy_from_slice(&work.offset);
        velocity.copy_from_slice(&work.velocity);
        *fade = Fade::of(offset, velocity, pad, around.time, rate, residual.rest_cm);
        // Nothing holds a strand farther off its place than it is long.
        let too_far = largest(offset, pad) > around.length_cm;
        if too_far || !(run(Sound(offset)) && run(Sound(velocity)) && run(Sound(&work.x))) {
            offset.fill(0.0);
            velocity.fill(0.0);
            slot.forget();
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
        let point = solid.at_end.point(point_at(&work.x, pad, j, s));
        let gap = plane_gap(touch, point);
        (touch.gap, touch.point) = (gap, point);
        least = least.min(gap);
        if gap < BEARING_CM {
            let normal = solid.at_end.vector_back(touch.normal);
            let at = dot(normal, point_at(&work.offset, pad, j, s));
            if at > 0.0 {
                bears = true;
                holds.push(Hold { strand: slot.strand, segment: touch.segment, s, held: scaled(normal, at) });
            }
        }
    }
    let (size, speed) = (largest(&work.offset, pad), largest(&work.velocity, pad));
    let gap = f64::from(least - WATCHED_TRAVEL * travel.last).max(0.0);
    slot.sleep(gap, travel.total, around.time, farthest(size, speed, rate), fastest(size, speed, rate));
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
    slot: &mut Slot,
    fade: &mut Fade,
    carried: &mut [f32],
    travel: Travel,
    reach: f32,
    work: &mut Work,
    holds: &mut Vec<Hold>,
) -> Outcome {
    let pad = around.pad;
    let clear = look(around, slot, 1.0, travel, reach, work);
    (slot.awake_at, slot.awake_from) = (travel.total, f64::INFINITY);
    if slot.n_touches == 0 {
        slot.awake_at += f64::from(clear);
        return Outcome::Away;
    }
    let gap_kept = around.params.guides.contact.offset_cm as f32;
    let mut inside = false;
    for touch in &slot.touches[..usize::from(slot.n_touches)] {
        let depth = -(touch.gap + gap_kept);
        if depth > 0.0 {
            inside = true;
            let normal = around.solids[usize::from(touch.solid)].at_end.vector_back(touch.normal);
            holds.push(Hold { strand: slot.strand, segment: touch.segment, s: touch.s, held: scaled(normal, depth) });
        }
    }
    if around.params.residual.correction == Correction::Position {
        for solid in around.solids {
            for i in N_FIXED..around.n {
                let p = Vector3::from(solid.at_end.point(particle(&work.x, pad, i)));
                let (distance, normal) = solid.solid.sdf.outward_normal(p);
                if distance < gap_kept {
                    let by = solid.at_end.vector_back((normal * (gap_kept - distance)).into());
                    for c in 0..3 {
                        work.x[c * pad + i] += by[c];
                    }
                }
            }
        }
        let (offset, velocity) = carried.split_at_mut(3 * pad);
        for ((d, x), s) in offset.iter_mut().zip(&work.x).zip(&work.skin) {
            *d = x - s;
        }
        velocity.fill(0.0);
        // There for whoever reads this step, gone in the next.
        *fade = Fade { stamp: around.time, gone_at: around.time + 0.5 * around.dt };
    }
    if inside { Outcome::Pushed } else { Outcome::Near }
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
    friction: Option<&SkinAtStart>,
    work: &mut Work,
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
            if let Some(skin_at_start) = friction.filter(|_| sweep == 0) {
                if !start_known {
                    skin_at_start(&mut work.old_skin);
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
    work: &Work,
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

/// Looks at the strand where it now is: what is nearer than the reach becomes its touches. Returns how far all else surely is beyond the
/// distance kept, cm.
fn look(around: &Surroundings, slot: &mut Slot, alpha: f32, travel: Travel, reach: f32, work: &mut Work) -> f32 {
    let (pad, n) = (around.pad, around.n);
    let gap_kept = around.params.guides.contact.offset_cm as f32;
    let longest = longest_segment(&work.x, pad, n);
    if travel.total >= slot.marked_until {
        let rate = around.params.residual.return_rate;
        let own = farthest(largest(&work.offset, pad), largest(&work.velocity, pad), rate);
        slot.marked = 0;
        let mut bound = f32::INFINITY;
        for solid in around.solids {
            let x = Particles { x: &work.x, pad };
            let (marked, clear) = Look::marks(&sight(around, solid, alpha, longest, reach), x, reach + MARKED_CM);
            slot.marked |= marked;
            bound = bound.min(clear);
        }
        slot.marked_until = travel.total + f64::from((bound - reach - own).max(0.0));
    }
    let mut clear = reach + (slot.marked_until - travel.total) as f32;
    let mut count = 0;
    for (k, solid) in around.solids.iter().enumerate() {
        if slot.marked == 0 {
            break;
        }
        let x = Particles { x: &work.x, pad };
        clear = clear.min(work.look.at_strand(&sight(around, solid, alpha, longest, reach), x, slot.marked));
        for near in &work.look.found {
            let gap = near.distance - gap_kept;
            let touch = Touch {
                solid: k as u16,
                segment: near.segment,
                s: near.s,
                gap,
                point: near.point,
                normal: near.normal,
            };
            if count < MAX_TOUCHES {
                slot.touches[count] = touch;
                count += 1;
            } else {
                // The least of all are kept; the others bound what is not remembered.
                let most = (0..count).fold(0, |m, i| if slot.touches[i].gap > slot.touches[m].gap { i } else { m });
                clear = clear.min(gap_kept + gap.max(slot.touches[most].gap));
                if gap < slot.touches[most].gap {
                    slot.touches[most] = touch;
                }
            }
        }
    }
    slot.n_touches = count as u8;
    clear - gap_kept
}

/// A solid as it is looked at at fraction `alpha` of the step.
fn sight<'a>(around: &Surroundings<'a>, solid: &SolidInHead<'a>, alpha: f32, longest: f32, reach: f32) -> Sight<'a> {
    let spacing = around.params.guides.contact.spacing_over_half_thickness as f32;
    Sight {
        field: &solid.solid.sdf,
        solid_from_head: solid.at(f64::from(alpha)),
        first: N_FIXED - 1,
        end: around.n,
        longest,
        reach,
        spacing: solid.solid.half_thickness_cm * spacing,
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
    work: &mut Work,
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
fn put_right(response: &Response, (segment, s): (usize, f32), by: [f32; 3], work: &mut Work) {
    response.push_at(segment, s, by, &mut work.x);
    response.push_at(segment, s, by, &mut work.offset);
}

/// Moves particles that are held off their place out of the head.
fn keep_out_of_head(around: &Surroundings, response: &Response, work: &mut Work) {
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
