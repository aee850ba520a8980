//! What the runtime keeps of each strand, and groups of strands that sleep while no solid can reach them.
//!
//! Strands are kept in an order of their own, neighbours together, so that a group shares its guides and wakes as one. A group adds
//! up how far its guides and the solids can have brought the two together since it was measured; until that exceeds the distance
//! measured, none of its strands is looked at. Invariant: a strand whose group has travelled less than its [`Wake::at`] surely meets no solid.

use crate::interpolate::{ActiveSet, MAX_PARTICLES, TransformArrays, Travelled, interpolate};
use crate::kernels::{Age, Longest, run};
use crate::offset::{N_FIXED, Return, fades_within, most_that_fades_within};
use crate::params::{Correction, RuntimeParams};
use crate::solid_in_head::{Frame, SolidInHead};
use io_formats::skinning_model::SkinningModel;
use nalgebra::Isometry3;

/// Strands that wake together.
pub(crate) const GROUP: usize = 32;

/// Most places at which a strand is remembered to be near solids.
pub(crate) const MAX_TOUCHES: usize = 6;

/// A place of a solid that a strand is near: a plane, fixed to the solid, that the strand must not cross where it passes.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Touch {
    pub solid: u16,
    /// From particle `segment` to the next, at `s` of the way, the strand passed it last.
    pub segment: u16,
    pub s: f32,
    /// Distance of `point` to the surface less the distance kept, cm.
    pub gap: f32,
    /// Where the strand was when it was looked at, and the way out, in the solid's frame.
    pub point: [f32; 3],
    pub normal: [f32; 3],
}

/// One strand's choice and state, but for its offset and velocity.
#[derive(Clone, Debug)]
pub(crate) struct Slot {
    pub strand: u32,
    /// Step at whose end the strand was looked at last.
    pub looked: u64,
    pub n_touches: u8,
    pub touches: [Touch; MAX_TOUCHES],
}

/// When a strand must be looked at. Kept apart from the rest, for a group asks it of all its strands.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wake {
    /// Travel of the group, or else time, from which the strand may meet a solid, cm and s.
    pub at: f64,
    pub from: f64,
}

/// How old a strand's offset is, and how long it lasts. Kept apart from the rest, for a read asks it of every strand.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fade {
    /// Time at which offset and velocity were last written, s.
    pub stamp: f64,
    /// Time from which the offset counts as gone, s.
    pub gone_at: f64,
}

impl Fade {
    /// Of a strand that carries nothing.
    pub(crate) const NONE: Self = Self { stamp: 0.0, gone_at: f64::NEG_INFINITY };

    /// Whether the strand carries an offset at `time`.
    pub(crate) fn carries(&self, time: f64) -> bool {
        self.gone_at > time
    }

    /// Of an offset and velocity just written (three arrays of `pad` values each).
    pub(crate) fn of(offset: &[f32], velocity: &[f32], pad: usize, time: f64, rate: f64, least_cm: f64) -> Self {
        let lasts = fades_within(largest(offset, pad), largest(velocity, pad), least_cm, rate);
        Self { stamp: time, gone_at: if lasts > 0.0 { time + lasts } else { f64::NEG_INFINITY } }
    }
}

/// Where strands are held off what their guides make of them, at one time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Offsets<'a> {
    pub slot_of: &'a [u32],
    pub fades: &'a [Fade],
    pub carried: &'a [f32],
    pub n_particles: usize,
    pub pad: usize,
    pub time: f64,
    /// As [`Fade::of`] took them.
    pub rate: f64,
    pub least_cm: f64,
}

impl Offsets<'_> {
    /// Whether a strand is farther off than `least_cm` (RMS over its particles).
    pub(crate) fn is_held_off(&self, strand: usize, least_cm: f32) -> bool {
        let mut carried = [0.0; 6 * MAX_PARTICLES];
        let carried = &mut carried[..6 * self.pad];
        if !self.copy(strand, least_cm, carried) {
            return false;
        }
        let offset = carried[..3 * self.pad].chunks_exact(self.pad);
        let squares: f32 = offset.map(|x| x[..self.n_particles].iter().map(|x| x * x).sum::<f32>()).sum();
        // What is not finite is to be looked at.
        squares.is_nan() || squares > least_cm * least_cm * self.n_particles as f32
    }

    /// Writes a strand's offset and velocity (three arrays of `pad` values each) to `out`, unless no particle can be farther off than `least_cm`.
    pub(crate) fn write(&self, strand: usize, least_cm: f32, out: &mut Vec<f32>) -> bool {
        out.resize(6 * self.pad, 0.0);
        self.copy(strand, least_cm, out)
    }

    fn copy(&self, strand: usize, least_cm: f32, out: &mut [f32]) -> bool {
        let at = self.slot_of[strand] as usize;
        let fade = &self.fades[at];
        if !fade.carries(self.time)
            || most_that_fades_within(fade.gone_at - self.time, self.least_cm, self.rate) <= f64::from(least_cm)
        {
            return false;
        }
        out.copy_from_slice(&self.carried[at * 6 * self.pad..(at + 1) * 6 * self.pad]);
        let (offset, velocity) = out.split_at_mut(3 * self.pad);
        bring_up(fade, offset, velocity, self.time, self.rate);
        true
    }
}

/// Strands that wake together.
#[derive(Clone, Debug)]
pub(crate) struct Group {
    /// By how much guides and solids can have come together since the runtime was made, cm.
    pub travel: f64,
    /// Least of its strands.
    pub wake: Wake,
    /// Travel of the last step, cm.
    pub last_travel: f32,
    /// Travel when its part was met last, cm.
    pub met: f64,
    /// Guides that any of its strands may follow: range of [`Strands::leads`].
    leads: std::ops::Range<usize>,
}

/// A guide that some strand of a group may follow.
#[derive(Clone, Copy, Debug)]
struct Lead {
    guide: u16,
    /// Whether one does.
    followed: bool,
    /// The farthest that a particle of a strand of the group which may follow it is from the guide's own at rest, cm.
    farthest: f32,
}

/// All strands of a head.
#[derive(Debug)]
pub(crate) struct Strands {
    pub n_particles: usize,
    pub pad: usize,
    pub slots: Vec<Slot>,
    /// By slot, as the next.
    pub wakes: Vec<Wake>,
    pub fades: Vec<Fade>,
    pub groups: Vec<Group>,
    /// By group, sorted by guide.
    leads: Vec<Lead>,
    /// Slot of each strand.
    pub slot_of: Vec<u32>,
    /// What each strand follows.
    pub active: Vec<ActiveSet>,
    /// Rest positions by strand: three arrays (x, y, z) of `pad` values; padding repeats the tip; cm, head frame.
    pub rest: Vec<f32>,
    /// Offset, then velocity, by slot, three arrays of `pad` values each; cm and cm/s, head frame.
    pub carried: Vec<f32>,
    /// Position of each particle along its strand, 0 to 1, padded with one.
    pub u: Vec<f32>,
}

impl Strands {
    /// `active` holds each strand's first set.
    pub(crate) fn new(model: &SkinningModel, pad: usize, active: Vec<ActiveSet>) -> Self {
        let n = model.n_particles as usize;
        let n_strands = model.n_strands as usize;
        let order = order(model, &active);
        let mut slot_of = vec![0; n_strands];
        let mut rest = Vec::with_capacity(n_strands * 3 * pad);
        for s in 0..n_strands {
            let points = model.rest_of(s);
            for c in 0..3 {
                rest.extend((0..pad).map(|i| points[i.min(n - 1)][c]));
            }
        }
        let mut slots = Vec::with_capacity(n_strands);
        for (slot, &strand) in order.iter().enumerate() {
            slot_of[strand as usize] = slot as u32;
            slots.push(Slot { strand, looked: u64::MAX, n_touches: 0, touches: [Touch::default(); MAX_TOUCHES] });
        }
        let mut leads: Vec<Lead> = Vec::new();
        let mut groups = Vec::with_capacity(n_strands.div_ceil(GROUP));
        for members in order.chunks(GROUP) {
            let first = leads.len();
            for &s in members {
                for &guide in model.eligible_of(s as usize) {
                    let led = model.rest_of(model.guide_strands[usize::from(guide)] as usize);
                    let apart2 = model.rest_of(s as usize).iter().zip(led).fold(0.0f32, |most, (p, q)| {
                        most.max((p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2) + (p[2] - q[2]).powi(2))
                    });
                    leads.push(Lead { guide, followed: false, farthest: apart2.sqrt() });
                }
            }
            leads[first..].sort_unstable_by_key(|lead| lead.guide);
            let mut kept = first;
            for k in first..leads.len() {
                if k == first || leads[k].guide != leads[kept - 1].guide {
                    leads[kept] = leads[k];
                    kept += 1;
                } else {
                    leads[kept - 1].farthest = leads[kept - 1].farthest.max(leads[k].farthest);
                }
            }
            leads.truncate(kept);
            let leads_here = first..kept;
            note_followed(&mut leads[leads_here.clone()], members.iter().map(|&s| &active[s as usize]));
            groups.push(Group { travel: 0.0, wake: Wake::NOW, last_travel: 0.0, met: 0.0, leads: leads_here });
        }
        Self {
            n_particles: n,
            pad,
            carried: vec![0.0; slots.len() * 6 * pad],
            wakes: vec![Wake::NOW; slots.len()],
            fades: vec![Fade::NONE; slots.len()],
            slots,
            groups,
            leads,
            slot_of,
            active,
            rest,
            u: (0..pad).map(|i| i.min(n - 1) as f32 / (n - 1) as f32).collect(),
        }
    }

    /// How far a strand may move without meeting a solid, cm; zero if it is near one.
    pub(crate) fn clearance(&self, strand: usize) -> f32 {
        let at = self.slot_of[strand] as usize;
        let (slot, group) = (&self.slots[at], &self.groups[at / GROUP]);
        if slot.n_touches > 0 { 0.0 } else { (self.wakes[at].at - group.travel).max(0.0) as f32 }
    }

    /// Where strands are held off at `time`, if they leave broken sets for that alone ([`crate::AssignParams::leave_gain_cm`]).
    pub(crate) fn offsets_to_leave_by(&self, time: f64, params: &RuntimeParams) -> Option<Offsets<'_>> {
        let residual = &params.residual;
        let (rate, least_cm) = (residual.return_rate, residual.rest_cm);
        let &Self { n_particles, pad, .. } = self;
        let Self { slot_of, fades, carried, .. } = self;
        (residual.correction == Correction::Carried && params.assign.leave_gain_cm >= 0.0).then_some(Offsets {
            slot_of,
            fades,
            carried,
            n_particles,
            pad,
            time,
            rate,
            least_cm,
        })
    }

    /// Forgets where solids are: every strand is looked at anew.
    pub(crate) fn forget_touches(&mut self) {
        self.slots.iter_mut().for_each(|slot| slot.n_touches = 0);
        self.wakes.fill(Wake::NOW);
        for group in &mut self.groups {
            group.wake = Wake::NOW;
            group.met = group.travel;
        }
    }

    /// Drops all offsets.
    pub(crate) fn forget_offsets(&mut self) {
        self.fades.fill(Fade::NONE);
    }

    /// Adds a step's travel to every group: how far guides and solids have moved against each other, from `before` to `now`. `travelled` is
    /// room for what each guide has moved, as seen from the head and from each solid.
    ///
    /// Seen from a solid whatever follows guides has moved as they have: transforms are affine, weights sum to one. Far from a
    /// solid that turns, what the solid has moved itself is the better bound.
    pub(crate) fn travel(
        &mut self,
        model: &SkinningModel,
        before: &TransformArrays,
        now: &TransformArrays,
        solids: &[SolidInHead],
        travelled: &mut Vec<Travelled>,
    ) {
        let views = 1 + solids.len();
        let still = Frame::new(&Isometry3::identity());
        travelled.clear();
        for (g, &strand) in model.guide_strands.iter().enumerate() {
            let rest = model.rest_of(strand as usize);
            let from = std::iter::once(&still).chain(solids.iter().map(|solid| &solid.carries));
            travelled.extend(from.map(|carries| now.travel_since(before, g, rest, carries)));
        }
        for group in &mut self.groups {
            let most = self.leads[group.leads.clone()].iter().fold(0.0f32, |most, lead| {
                if !lead.followed {
                    return most;
                }
                let of_guide = &travelled[usize::from(lead.guide) * views..][..views];
                let own = of_guide[0].within(lead.farthest);
                let against = of_guide[1..].iter().zip(solids);
                against.fold(most, |most, (seen, solid)| most.max(seen.within(lead.farthest).min(own + solid.moved)))
            });
            group.last_travel = most;
            group.travel += f64::from(group.last_travel);
        }
    }

    /// Changes a strand's set at `time`: it stays where it is, and what the change would move it by becomes offset.
    pub(crate) fn change_set(
        &mut self,
        strand: usize,
        active: ActiveSet,
        transforms: &TransformArrays,
        time: f64,
        rate: f64,
        least_cm: f64,
        skins: &mut [Vec<f32>; 2],
    ) {
        let pad = self.pad;
        let at = self.slot_of[strand] as usize;
        let rest = &self.rest[strand * 3 * pad..(strand + 1) * 3 * pad];
        for skin in skins.iter_mut() {
            skin.resize(3 * pad, 0.0);
        }
        interpolate(rest, &self.u, &self.active[strand], transforms, &mut skins[0]);
        self.active[strand] = active;
        interpolate(rest, &self.u, &self.active[strand], transforms, &mut skins[1]);
        let (offset, velocity) = self.carried[at * 6 * pad..(at + 1) * 6 * pad].split_at_mut(3 * pad);
        bring_up(&self.fades[at], offset, velocity, time, rate);
        for c in 0..3 {
            for i in c * pad + N_FIXED..(c + 1) * pad {
                offset[i] += skins[0][i] - skins[1][i];
            }
        }
        self.fades[at] = Fade::of(offset, velocity, pad, time, rate, least_cm);
        // The strand will move on its own: it must be looked at.
        self.wakes[at] = Wake::NOW;
        let group = &mut self.groups[at / GROUP];
        group.wake = Wake::NOW;
        let first = at / GROUP * GROUP;
        let members = &self.slots[first..self.slots.len().min(first + GROUP)];
        let followed = members.iter().map(|slot| &self.active[slot.strand as usize]);
        note_followed(&mut self.leads[group.leads.clone()], followed);
    }
}

/// Marks the guides of a group that its strands follow.
fn note_followed<'a>(leads: &mut [Lead], sets: impl Iterator<Item = &'a ActiveSet>) {
    leads.iter_mut().for_each(|lead| lead.followed = false);
    for set in sets {
        for guide in &set.guides[..usize::from(set.n)] {
            // Sets hold eligible guides only.
            if let Ok(at) = leads.binary_search_by_key(guide, |lead| lead.guide) {
                leads[at].followed = true;
            }
        }
    }
}

impl Wake {
    /// In the next step.
    pub(crate) const NOW: Self = Self { at: f64::NEG_INFINITY, from: f64::INFINITY };

    /// Whether a group's travel and the time have come so far.
    pub(crate) fn is_due(&self, travel: f64, time: f64) -> bool {
        travel >= self.at || time >= self.from
    }

    /// The first of both.
    pub(crate) fn first(self, other: Self) -> Self {
        Self { at: self.at.min(other.at), from: self.from.min(other.from) }
    }

    /// When a strand may have come `gap` cm nearer to a solid by its group's travel and by its offset's own motion, which is never faster
    /// than `speed` and never leads farther than `own` cm.
    pub(crate) fn after(gap: f64, travel: f64, time: f64, own: f32, speed: f32) -> Self {
        let own = f64::from(own);
        if own <= 0.25 * gap {
            Self { at: travel + gap - own, from: f64::INFINITY }
        } else {
            Self { at: travel + 0.5 * gap, from: time + 0.5 * gap / f64::from(speed) }
        }
    }
}

/// Offset and velocity at `time` in place of those of the time they were written.
pub(crate) fn bring_up(fade: &Fade, offset: &mut [f32], velocity: &mut [f32], time: f64, rate: f64) {
    if !fade.carries(time) {
        offset.fill(0.0);
        velocity.fill(0.0);
        return;
    }
    run(Age { offset, velocity, back: Return::over(time - fade.stamp, rate) });
}

/// Length of the longest of `pad` vectors kept as three arrays.
pub(crate) fn largest(values: &[f32], pad: usize) -> f32 {
    run(Longest { values, pad })
}

/// Strands with neighbours together: by the guide they depend on most, then along a curve through the middle of their rest.
pub(crate) fn order(model: &SkinningModel, active: &[ActiveSet]) -> Vec<u32> {
    let n_strands = model.n_strands as usize;
    let middle = |s: usize| model.rest_of(s)[model.n_particles as usize / 2];
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for s in 0..n_strands {
        for c in 0..3 {
            low[c] = low[c].min(middle(s)[c]);
            high[c] = high[c].max(middle(s)[c]);
        }
    }
    let key = |s: usize| {
        let set = &active[s];
        let weights = set.weights_at(0.5);
        let heaviest = (0..usize::from(set.n)).fold(0, |best, k| if weights[k] > weights[best] { k } else { best });
        let mut code = 0u32;
        for c in 0..3 {
            let share = (middle(s)[c] - low[c]) / (high[c] - low[c]).max(1e-6);
            let place = (share * 1023.0) as u32;
            for bit in 0..10 {
                code |= (place >> bit & 1) << (3 * bit + c);
            }
        }
        (set.guides[heaviest], code, s as u32)
    };
    let mut keys: Vec<(u16, u32, u32)> = (0..n_strands).map(key).collect();
    keys.sort_unstable();
    keys.into_iter().map(|(_, _, s)| s).collect()
}
