//! The interpolation check (AS16 §4.2) kept from step to step: the same answers as testing every ribbon anew, for little.
//!
//! Of each pair and solid is kept, per rung, how far both may still move before the check might call the ribbon there
//! blocked; and of a blocked pair a witness, a place on the ribbon well inside the solid. Only rungs whose budget is used
//! up are looked at, and a witness that is still inside settles a pair with one sample. What neither settles is tested as
//! [`strand_ribbon_keeps_clear`] tests it, so that every answer is that function's.

mod occupied;

use super::GuideMotion;
use collision::MovingSolid;
use collision::clearance::{STRIPS, Standing, rung_blocked_at, rung_is_blocked_there};
use collision::sdf::{FieldId, SignedDistanceField};
use nalgebra::Vector3;
use occupied::Occupied;

#[cfg(doc)]
use collision::clearance::strand_ribbon_keeps_clear;

/// Pieces of this radius (cm) are not cut further for a budget: the check itself costs no more.
const FINEST_CM: f32 = 0.05;

/// A budget of this many steps' motion is worth taking as it is: more would take more samples than it saves.
const LONG_ENOUGH: f32 = 1.5;

/// What is added to each step's motion and taken off each budget, cm: more than single precision loses in their sums.
const SLACK_CM: f32 = 2e-5;

/// An odometer past this (cm) is set back, so that it stays precise.
const LONGEST_CM: f32 = 64.0;

/// A solid as the check sees it in this step.
#[derive(Clone, Debug)]
struct Seen {
    field: FieldId,
    standing: Standing,
    occupied: Occupied,
    /// cm.
    resolution: f32,
    half_thickness: f32,
    /// Guide particles in the solid's frame at the step before, cm.
    before: Vec<Vector3<f32>>,
    /// Most that any particle of each guide has moved against the solid since, cm.
    moved: Vec<f32>,
}

/// Where on a pair's ribbon a solid was found.
#[derive(Clone, Copy, Debug)]
struct Witness {
    rung: u16,
    /// From the first guide to the second, and along the rung; 0 to 1.
    across: f32,
    along: f32,
}

/// What is known of one pair and one solid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Known {
    /// Motion since it was last set back, cm.
    odometer: f32,
    /// Least of the pair's expiries.
    soonest: f32,
    witness: Option<Witness>,
    /// Whether it was found free when last decided.
    was_free: bool,
}

/// Kept knowledge of all pairs and solids.
#[derive(Clone, Debug, Default)]
pub(super) struct GapCheck {
    n_rungs: usize,
    seen: Vec<Seen>,
    /// Pair-major, one per solid.
    pub known: Vec<Known>,
    /// Pair-major, per solid and rung [`STRIPS`] odometer readings from which on the strip must be looked at again.
    pub expiry: Vec<f32>,
}

/// What deciding a step's pairs reads.
pub(super) struct Decider<'a> {
    seen: &'a [Seen],
    motion: &'a GuideMotion<'a>,
    solids: &'a [MovingSolid<'a>],
    n_rungs: usize,
}

impl GapCheck {
    /// Takes over a step's motion. Returns what decides pairs, and what is known of them, in pairs-major order.
    pub fn begin<'a>(
        &'a mut self,
        n_pairs: usize,
        motion: &'a GuideMotion,
        solids: &'a [MovingSolid],
        gap_resolution: f32,
    ) -> (Decider<'a>, &'a mut [Known], &'a mut [f32]) {
        let n = motion.n_particles;
        self.n_rungs = n.saturating_sub(1);
        let same = self.seen.len() == solids.len()
            && self.known.len() == n_pairs * solids.len()
            && self.seen.iter().zip(solids).all(|(seen, moving)| {
                seen.field == moving.solid.sdf.id()
                    && seen.resolution == gap_resolution * moving.solid.half_thickness_cm
                    && seen.before.len() == motion.position_in_head.len()
            });
        if !same {
            self.forget(n_pairs, motion, solids, gap_resolution);
        }
        for (seen, now) in self.seen.iter_mut().zip(motion.position_in_solids) {
            let guides = now.chunks_exact(n).zip(seen.before.chunks_exact_mut(n));
            for ((now, before), moved) in guides.zip(&mut seen.moved) {
                let mut most = 0.0f32;
                for (p, q) in now.iter().zip(before) {
                    most = larger(most, (p - *q).norm_squared());
                    *q = *p;
                }
                *moved = most.sqrt() + SLACK_CM;
            }
        }
        let decider = Decider { seen: &self.seen, motion, solids, n_rungs: self.n_rungs };
        (decider, &mut self.known, &mut self.expiry)
    }

    fn forget(&mut self, n_pairs: usize, motion: &GuideMotion, solids: &[MovingSolid], gap_resolution: f32) {
        self.seen.clear();
        self.seen.extend(solids.iter().zip(motion.position_in_solids).map(|(moving, now)| {
            let standing = Standing::of(&moving.solid.sdf);
            Seen {
                field: moving.solid.sdf.id(),
                occupied: Occupied::of(&moving.solid.sdf, &standing),
                standing,
                resolution: gap_resolution * moving.solid.half_thickness_cm,
                half_thickness: moving.solid.half_thickness_cm,
                before: now.clone(),
                moved: vec![0.0; now.len() / motion.n_particles],
            }
        }));
        self.known.clear();
        let unknown = Known { odometer: 0.0, soonest: f32::NEG_INFINITY, witness: None, was_free: false };
        self.known.resize(n_pairs * solids.len(), unknown);
        self.expiry.clear();
        self.expiry.resize(self.known.len() * self.n_rungs * STRIPS, f32::NEG_INFINITY);
    }
}

impl Decider<'_> {
    fn n_strips(&self) -> usize {
        self.n_rungs * STRIPS
    }

    /// Values of [`GapCheck::known`] and of [`GapCheck::expiry`] per pair.
    pub fn strides(&self) -> [usize; 2] {
        [self.seen.len(), self.seen.len() * self.n_rungs * STRIPS]
    }

    /// Counts the step's motion of a pair; to be called once for each pair and step, before [`Self::is_free`].
    pub fn count(&self, [i, j]: [u16; 2], known: &mut [Known], expiry: &mut [f32]) {
        for (s, (known, seen)) in known.iter_mut().zip(self.seen).enumerate() {
            let (a, b) = (seen.moved[usize::from(i)], seen.moved[usize::from(j)]);
            known.odometer += larger(a, b);
            if known.odometer > LONGEST_CM || known.odometer.is_nan() {
                let past = known.odometer;
                for e in &mut expiry[s * self.n_strips()..(s + 1) * self.n_strips()] {
                    *e -= past;
                    if !e.is_finite() {
                        *e = f32::NEG_INFINITY;
                    }
                }
                known.soonest = f32::NEG_INFINITY;
                known.odometer = 0.0;
            }
        }
    }

    /// Whether the ribbon between two guides is free of all solids; where it is not the pair's turn and what is known does not settle
    /// it, whether it was when that was last decided.
    pub fn is_free(&self, [i, j]: [u16; 2], known: &mut [Known], expiry: &mut [f32], is_turn: bool) -> bool {
        let n = self.motion.n_particles;
        let of = |g: u16| usize::from(g) * n..(usize::from(g) + 1) * n;
        (0..self.seen.len()).all(|s| {
            let positions = &self.motion.position_in_solids[s];
            let pair = Pair {
                seen: &self.seen[s],
                sdf: &self.solids[s].solid.sdf,
                motion: larger(self.seen[s].moved[usize::from(i)], self.seen[s].moved[usize::from(j)]),
                first: &positions[of(i)],
                second: &positions[of(j)],
            };
            pair.is_free(&mut known[s], &mut expiry[s * self.n_strips()..(s + 1) * self.n_strips()], is_turn)
        })
    }
}

/// One pair before one solid, in its frame.
struct Pair<'a> {
    seen: &'a Seen,
    sdf: &'a SignedDistanceField,
    /// What the pair moved in this step, cm.
    motion: f32,
    first: &'a [Vector3<f32>],
    second: &'a [Vector3<f32>],
}

impl Pair<'_> {
    fn is_free(&self, known: &mut Known, expiry: &mut [f32], is_turn: bool) -> bool {
        if let Some(witness) = &mut known.witness {
            if self.follow(witness) || !is_turn {
                return false;
            }
            let rung = usize::from(witness.rung);
            if let Some(place) = self.blocked_at(rung, 0) {
                *witness = Witness::new(rung, place);
                return false;
            }
            known.witness = None;
            known.soonest = f32::NEG_INFINITY;
            expiry[rung * STRIPS..(rung + 1) * STRIPS].fill(known.odometer);
        }
        if known.odometer < known.soonest || (known.was_free && !is_turn) {
            return true;
        }
        known.was_free = false;
        if let Some(witness) = self.renew(0, expiry, known.odometer) {
            known.witness = Some(witness);
            return false;
        }
        known.soonest = soonest(expiry);
        known.was_free = true;
        true
    }

    fn blocked_at(&self, rung: usize, free: u8) -> Option<[f32; 2]> {
        rung_blocked_at(self.sdf, self.first, self.second, rung, self.seen.resolution, (&self.seen.standing, free))
    }

    /// Looks again at the used-up ones of the rungs from `start` on; returns where one is blocked, if any.
    fn renew(&self, start: usize, expiry: &mut [f32], odometer: f32) -> Option<Witness> {
        if odometer < soonest(expiry) {
            return None;
        }
        let n = expiry.len() / STRIPS;
        // The ribbon's rungs from `start` on lie in one box, and in one ball.
        let (a, b) = (&self.first[start..=start + n], &self.second[start..=start + n]);
        let mut budget = self.seen.occupied.distance_from(a.iter().chain(b));
        if n > 1 {
            let middle = (a[0] + a[n] + b[0] + b[n] + 2.0 * (a[n / 2] + b[n / 2])) * 0.125;
            let squared = a.iter().chain(b).map(|p| (p - middle).norm_squared());
            let radius = squared.fold(0.0, larger).sqrt();
            // Smaller boxes and balls could give no more than about twice what is taken here.
            if budget < radius || radius.is_nan() {
                budget = budget.max(self.seen.standing.budget(middle, radius));
            }
            if budget < radius || radius.is_nan() {
                let (low, high) = expiry.split_at_mut(n / 2 * STRIPS);
                return self.renew(start, low, odometer).or_else(|| self.renew(start + n / 2, high, odometer));
            }
        }
        if n > 1 || budget > LONG_ENOUGH * self.motion {
            let until = odometer + budget - SLACK_CM;
            expiry.iter_mut().for_each(|e| *e = e.max(until));
            return None;
        }
        self.renew_rung(start, expiry, odometer)
    }

    /// [`Self::renew`] for the strips of one rung.
    fn renew_rung(&self, rung: usize, expiry: &mut [f32], odometer: f32) -> Option<Witness> {
        let [a0, b0, a1, b1] = self.corners(rung);
        let mut free = 0;
        for (strip, expiry) in expiry.iter_mut().enumerate() {
            if odometer < *expiry {
                free |= 1 << strip;
                continue;
            }
            let (from, to) = (strip as f32 / STRIPS as f32, (strip + 1) as f32 / STRIPS as f32);
            let corners = [a0.lerp(&b0, from), a0.lerp(&b0, to), a1.lerp(&b1, from), a1.lerp(&b1, to)];
            let budget = self.budget(corners);
            if budget > SLACK_CM {
                *expiry = odometer + budget - SLACK_CM;
                free |= 1 << strip;
            } else {
                // If free, it is to be looked at in the next step again.
                *expiry = odometer;
            }
        }
        if free == u8::MAX {
            return None;
        }
        self.blocked_at(rung, free).map(|place| Witness::new(rung, place))
    }

    /// How far the corners of a patch may move before the check might call it blocked, cm; not positive where that is not known.
    fn budget(&self, corners: [Vector3<f32>; 4]) -> f32 {
        let [a0, b0, a1, b1] = corners;
        let middle = (a0 + b0 + a1 + b1) * 0.25;
        let squared = corners.iter().map(|p| (p - middle).norm_squared());
        let radius = squared.fold(0.0, larger).sqrt();
        let budget = self.seen.standing.budget(middle, radius);
        if budget > LONG_ENOUGH * self.motion {
            return budget;
        }
        // Finer pieces are worth their samples only as long as they may give more. A comparison with not a number fails.
        if !(budget + radius > 0.0 && radius > FINEST_CM) {
            return budget;
        }
        let across = (b0 - a0).norm_squared().max((b1 - a1).norm_squared());
        let along = (a1 - a0).norm_squared().max((b1 - b0).norm_squared());
        let halves = if across > along {
            let (m0, m1) = ((a0 + b0) * 0.5, (a1 + b1) * 0.5);
            [[a0, m0, a1, m1], [m0, b0, m1, b1]]
        } else {
            let (ma, mb) = ((a0 + a1) * 0.5, (b0 + b1) * 0.5);
            [[a0, b0, ma, mb], [ma, mb, a1, b1]]
        };
        let first = self.budget(halves[0]);
        if first > 0.0 { first.min(self.budget(halves[1])) } else { first }
    }

    fn corners(&self, rung: usize) -> [Vector3<f32>; 4] {
        [self.first[rung], self.second[rung], self.first[rung + 1], self.second[rung + 1]]
    }

    /// Whether the check finds the ribbon blocked at the witness, which is moved down the distance field to stay with the solid.
    fn follow(&self, witness: &mut Witness) -> bool {
        const TRIES: usize = 3;
        let mut at = *witness;
        let mut deepest = f32::INFINITY;
        for _ in 0..TRIES {
            let [a0, b0, a1, b1] = self.corners(usize::from(at.rung));
            let (from, to) = (a0.lerp(&b0, at.across), a1.lerp(&b1, at.across));
            let (d, gradient) = self.sdf.distance_gradient(from.lerp(&to, at.along));
            // Half way from the surface to the middle is deep enough for any next step.
            let deep = -0.5 * self.seen.half_thickness;
            if d < deepest {
                (deepest, *witness) = (d, at);
            }
            if d > deep {
                let way = gradient * (deep - d.max(0.0)).max(-FARTHEST_CM);
                let across = (b0 - a0).lerp(&(b1 - a1), at.along);
                at = self.moved(at, part(&way, &across), part(&way, &(to - from)));
            }
            if d <= self.seen.standing.surely_inside {
                *witness = at;
                return true;
            }
        }
        let place = (usize::from(witness.rung), [witness.across, witness.along]);
        rung_is_blocked_there(self.sdf, self.first, self.second, place, self.seen.resolution)
    }

    fn moved(&self, at: Witness, across: f32, along: f32) -> Witness {
        let along = f32::from(at.rung) + at.along + along;
        let rung = along.floor().clamp(0.0, (self.first.len() - 2) as f32);
        let across = (at.across + across).clamp(0.0, 1.0);
        Witness { rung: rung as u16, across, along: (along - rung).clamp(0.0, 1.0) }
    }
}

/// Longest way that a witness is moved at once, cm.
const FARTHEST_CM: f32 = 0.5;

/// Share of `side` that leads as far as `way` along it; at most one.
fn part(way: &Vector3<f32>, side: &Vector3<f32>) -> f32 {
    let part = way.dot(side) / side.norm_squared();
    if part.is_finite() { part.clamp(-1.0, 1.0) } else { 0.0 }
}

impl Witness {
    fn new(rung: usize, [across, along]: [f32; 2]) -> Self {
        Self { rung: rung as u16, across, along }
    }
}

/// The least of some odometer readings, none of which is not a number; several at a time.
fn soonest(expiry: &[f32]) -> f32 {
    let mut least = [f32::INFINITY; STRIPS];
    for rung in expiry.as_chunks::<STRIPS>().0 {
        for l in 0..STRIPS {
            least[l] = if rung[l] < least[l] { rung[l] } else { least[l] };
        }
    }
    least.iter().copied().fold(f32::INFINITY, f32::min)
}

/// The larger; not a number if either is: what is not finite is to be looked at, and so blocked.
fn larger(a: f32, b: f32) -> f32 {
    if b > a || b.is_nan() { b } else { a }
}
