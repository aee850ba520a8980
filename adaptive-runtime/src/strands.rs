//! What the runtime keeps of each strand, and groups of strands that sleep while no solid can reach them.
//!
//! Strands are kept in an order of their own, neighbours together, so that a group shares its guides and wakes as one. A group adds
//! up how far its guides and the solids can have brought the two together since it was measured; until that exceeds the distance
//! measured, none of its strands is looked at. Invariant: a strand whose group has travelled less than `awake_at` surely meets no solid.

use crate::interpolate::{ActiveSet, TransformArrays, interpolate};
use crate::kernels::{Age, Longest, run};
use crate::offset::{N_FIXED, Return, fades_within};
use io_formats::skinning_model::SkinningModel;

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
    /// Travel of the group, or else time, from which the strand may meet a solid, cm and s.
    pub awake_at: f64,
    pub awake_from: f64,
    /// Step at whose end the strand was looked at last.
    pub looked: u64,
    pub n_touches: u8,
    pub touches: [Touch; MAX_TOUCHES],
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

/// Strands that wake together.
#[derive(Clone, Debug)]
pub(crate) struct Group {
    /// By how much guides and solids can have come together since the runtime was made, cm.
    pub travel: f64,
    /// Least `awake_at` and `awake_from` of its strands.
    pub wake_at: f64,
    pub wake_from: f64,
    /// Travel of the last step, cm.
    pub last_travel: f32,
    /// Guides that any of its strands may follow: range of [`Strands::group_guides`].
    guides: std::ops::Range<usize>,
}

/// All strands of a head.
#[derive(Debug)]
pub(crate) struct Strands {
    pub n_particles: usize,
    pub pad: usize,
    pub slots: Vec<Slot>,
    /// By slot.
    pub fades: Vec<Fade>,
    pub groups: Vec<Group>,
    group_guides: Vec<u16>,
    /// Slot of each strand.
    pub slot_of: Vec<u32>,
    /// What each strand follows.
    pub active: Vec<ActiveSet>,
    /// Rest positions by strand: three arrays (x, y, z) of `pad` values; padding repeats the tip; cm, head frame.
    pub rest: Vec<f32>,
    /// Offset, then velocity, by slot, three arrays of `pad` values each; cm and cm/s, head frame.
    pub carried: Vec<f32>,
    /// For each guide the farthest that a particle of a hair it may lead is from its own, cm.
    farthest: Vec<f32>,
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
            slots.push(Slot {
                strand,
                awake_at: f64::NEG_INFINITY,
                awake_from: f64::INFINITY,
                looked: u64::MAX,
                n_touches: 0,
                touches: [Touch::default(); MAX_TOUCHES],
            });
        }
        let mut group_guides = Vec::new();
        let mut groups = Vec::with_capacity(n_strands.div_ceil(GROUP));
        for members in order.chunks(GROUP) {
            let first = group_guides.len();
            for &s in members {
                group_guides.extend_from_slice(model.eligible_of(s as usize));
            }
            group_guides[first..].sort_unstable();
            let mut kept = first;
            for k in first..group_guides.len() {
                if k == first || group_guides[k] != group_guides[kept - 1] {
                    group_guides[kept] = group_guides[k];
                    kept += 1;
                }
            }
            group_guides.truncate(kept);
            groups.push(Group {
                travel: 0.0,
                wake_at: f64::NEG_INFINITY,
                wake_from: f64::INFINITY,
                last_travel: 0.0,
                guides: first..kept,
            });
        }
        let mut farthest = vec![0.0f32; model.n_guides()];
        for s in 0..n_strands {
            for &g in model.eligible_of(s) {
                let guide = model.rest_of(model.guide_strands[usize::from(g)] as usize);
                let far = &mut farthest[usize::from(g)];
                for (p, q) in model.rest_of(s).iter().zip(guide) {
                    let d2 = (p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2) + (p[2] - q[2]).powi(2);
                    *far = far.max(d2.sqrt());
                }
            }
        }
        Self {
            n_particles: n,
            pad,
            carried: vec![0.0; slots.len() * 6 * pad],
            fades: vec![Fade::NONE; slots.len()],
            slots,
            groups,
            group_guides,
            slot_of,
            active,
            rest,
            farthest,
            u: (0..pad).map(|i| i.min(n - 1) as f32 / (n - 1) as f32).collect(),
        }
    }

    /// How far a strand may move without meeting a solid, cm; zero if it is near one.
    pub(crate) fn clearance(&self, strand: usize) -> f32 {
        let at = self.slot_of[strand] as usize;
        let (slot, group) = (&self.slots[at], &self.groups[at / GROUP]);
        if slot.n_touches > 0 { 0.0 } else { (slot.awake_at - group.travel).max(0.0) as f32 }
    }

    /// Forgets where solids are: every strand is looked at anew.
    pub(crate) fn forget_touches(&mut self) {
        self.slots.iter_mut().for_each(Slot::forget);
        self.groups.iter_mut().for_each(|group| group.wake_at = f64::NEG_INFINITY);
    }

    /// Drops all offsets.
    pub(crate) fn forget_offsets(&mut self) {
        self.forget_touches();
        self.fades.fill(Fade::NONE);
    }

    /// Adds a step's travel to every group: of the guides from `before` to `now`, per guide into `guide_travel` (cm), and of the solids,
    /// at most `solid_cm`.
    pub(crate) fn travel(
        &mut self,
        model: &SkinningModel,
        before: &TransformArrays,
        now: &TransformArrays,
        solid_cm: f32,
        guide_travel: &mut Vec<f32>,
    ) {
        guide_travel.clear();
        for (g, &strand) in model.guide_strands.iter().enumerate() {
            let rest = model.rest_of(strand as usize);
            guide_travel.push(now.travel_since(before, g, rest, self.farthest[g]));
        }
        for group in &mut self.groups {
            let most = self.group_guides[group.guides.clone()]
                .iter()
                .fold(0.0f32, |most, &g| most.max(guide_travel[usize::from(g)]));
            group.last_travel = most + solid_cm;
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
        let slot = &mut self.slots[at];
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
        slot.awake_at = f64::NEG_INFINITY;
        self.groups[at / GROUP].wake_at = f64::NEG_INFINITY;
    }
}

impl Slot {
    /// Lets the strand sleep until it may have come `gap` cm nearer to a solid by its group's travel and by its offset's own motion, which
    /// is never faster than `speed` and never leads farther than `own` cm.
    pub(crate) fn sleep(&mut self, gap: f64, travel: f64, time: f64, own: f32, speed: f32) {
        let own = f64::from(own);
        if own <= 0.25 * gap {
            (self.awake_at, self.awake_from) = (travel + gap - own, f64::INFINITY);
        } else {
            (self.awake_at, self.awake_from) = (travel + 0.5 * gap, time + 0.5 * gap / f64::from(speed));
        }
    }

    /// Forgets touches.
    pub(crate) fn forget(&mut self) {
        self.n_touches = 0;
        self.awake_at = f64::NEG_INFINITY;
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
fn order(model: &SkinningModel, active: &[ActiveSet]) -> Vec<u32> {
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
