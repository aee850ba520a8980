//! Hair meets hair: what is near what, and the three things done about it (MS08 §5.2, §5.3).
//!
//! [`stiction`] joins near segments by springs, [`repulsion`] keeps the others apart (steps 3 and 9 of MS08 §4), and
//! [`mod@collide`] stops what would still pass through within a step (step 6). All work on flat arrays of the hair's own
//! particles, strand-major, root first; perturbed particles take no part. Invariant: impulses between free particles keep
//! their total momentum, kinematic particles never move, and results do not depend on the thread count.

pub mod blocks;
pub mod collide;
pub mod repulsion;
pub mod slices;
pub mod stiction;

use collision::segment_pair::{Segment, Sweep, closest_points};
use collision::spatial_hash::{Pair, PairList, SegmentGrid};
use nalgebra::Vector3;

pub use blocks::Blocks;
pub use collide::{CollideParams, CollisionReport, CollisionWorkspace, collide, passes};
pub use repulsion::{RepulsionParams, RepulsionReport, repel};
pub use slices::{ContactSampling, SliceSearch};
pub use stiction::{HairStyle, Link, LinkReport, LinkSet, LinkSpring, StictionParams, StictionWorkspace};

/// Segments of one strand closer than this along it are never paired: they share a particle, or a bend brings them
/// together that the bend springs already resist.
pub const SAME_STRAND_GAP: u32 = 4;

/// Strands as flat arrays, strand-major, root first.
#[derive(Clone, Copy, Debug)]
pub struct Strands<'a> {
    n_particles: usize,
    position: &'a [Vector3<f64>],
    inv_mass: &'a [f64],
}

impl<'a> Strands<'a> {
    /// `n_particles` a strand; positions in cm; reciprocal masses in 1/g, zero for kinematic particles.
    ///
    /// # Panics
    /// If the arrays differ in length, do not hold whole strands, or strands have fewer than two particles.
    #[must_use]
    pub fn new(n_particles: usize, position: &'a [Vector3<f64>], inv_mass: &'a [f64]) -> Self {
        assert!(n_particles >= 2, "a strand needs two particles to have a segment");
        assert_eq!(position.len(), inv_mass.len(), "one reciprocal mass per particle");
        assert!(position.len().is_multiple_of(n_particles), "whole strands");
        Self { n_particles, position, inv_mass }
    }

    /// The same strands elsewhere.
    ///
    /// # Panics
    /// If there is not one position per particle.
    #[must_use]
    pub fn at<'b>(&self, position: &'b [Vector3<f64>]) -> Strands<'b>
    where
        'a: 'b,
    {
        Strands::new(self.n_particles, position, self.inv_mass)
    }

    /// Particles, all strands together.
    #[must_use]
    pub fn n_points(&self) -> usize {
        self.position.len()
    }

    /// Particles of one strand.
    #[must_use]
    pub fn n_particles(&self) -> usize {
        self.n_particles
    }

    /// Segments, numbered strand by strand, root first.
    #[must_use]
    pub fn n_segments(&self) -> usize {
        self.position.len() / self.n_particles * (self.n_particles - 1)
    }

    /// Particle at the root end of a segment; the next one is at its other end.
    #[inline(always)]
    #[must_use]
    pub fn first_particle(&self, segment: usize) -> usize {
        // A 32-bit division is several times cheaper, and segments are numbered in 32 bits.
        segment + (segment as u32 / (self.n_particles as u32 - 1)) as usize
    }

    /// Both ends of a segment, cm.
    #[inline(always)]
    #[must_use]
    pub fn segment(&self, segment: usize) -> Segment {
        segment_at(self.position, self.first_particle(segment))
    }

    /// Whether two segments are not neighbours on one strand.
    #[inline(always)]
    fn are_apart(&self, i: usize, j: usize) -> bool {
        let per_strand = self.n_particles as u32 - 1;
        (j as u32).abs_diff(i as u32) >= SAME_STRAND_GAP || i as u32 / per_strand != j as u32 / per_strand
    }

    /// Whether two segments may meet at all: not neighbours on one strand, and not all four ends kinematic.
    #[inline(always)]
    fn may_meet(&self, i: usize, j: usize) -> bool {
        let (a, b) = (self.first_particle(i), self.first_particle(j));
        self.are_apart(i, j) && self.inv_mass[a] + self.inv_mass[a + 1] + self.inv_mass[b] + self.inv_mass[b + 1] > 0.0
    }
}

#[inline(always)]
fn segment_at(position: &[Vector3<f64>], first: usize) -> Segment {
    [position[first], position[first + 1]]
}

/// Where two near segments are closest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Near {
    /// Place on the first segment, 0 at its root end.
    pub s: f64,
    /// Place on the second.
    pub t: f64,
    /// From the first segment's point to the second's, cm.
    pub offset: Vector3<f64>,
}

/// All pairs of segments closer than a reach, ascending, with buffers kept from step to step.
#[derive(Clone, Debug, Default)]
pub struct NearPairs {
    grid: SegmentGrid,
    list: PairList<Near>,
    /// Reach of each segment, cm.
    reach: Vec<f64>,
}

impl NearPairs {
    /// Finds the pairs closer than `reach_cm`. Strands with a position that is not finite are near nothing there.
    pub fn find(&mut self, strands: &Strands, reach_cm: f64) {
        self.reach.clear();
        self.reach.resize(strands.n_segments(), reach_cm);
        self.find_within_reach(strands);
    }

    /// Finds the pairs closer than a thickness, and those that may link: within the distance at which links are made, with
    /// room for one more on both segments. In hair that sticks already these are few.
    pub fn find_to_link(&mut self, strands: &Strands, links: &LinkSet, params: &StictionParams, thickness_cm: f64) {
        self.reach.clear();
        self.reach.resize(strands.n_segments(), 0.0);
        // First the number held, then the reach that follows from it.
        for link in links.links() {
            self.reach[link.i as usize] += 1.0;
            self.reach[link.j as usize] += 1.0;
        }
        let most = params.max_links as f64;
        let longest = params.make_cm.max(thickness_cm);
        self.reach.iter_mut().for_each(|r| *r = if *r < most { longest } else { thickness_cm });
        self.find_within_reach(strands);
    }

    fn find_within_reach(&mut self, strands: &Strands) {
        let Self { grid, list, reach } = self;
        let longest = reach.iter().fold(0.0_f64, |a, &b| a.max(b));
        grid.rebuild(strands.n_segments(), longest, |i| Sweep::still(strands.segment(i)));
        grid.collect_within(
            list,
            |i| reach[i],
            |i, j| {
                if !strands.may_meet(i, j) {
                    return None;
                }
                let c = closest_points(&strands.segment(i), &strands.segment(j));
                let reach = reach[i].min(reach[j]);
                (c.distance2 < reach * reach).then_some(Near { s: c.s, t: c.t, offset: c.offset })
            },
        );
    }

    /// The pairs found, ascending.
    #[must_use]
    pub fn pairs(&self) -> &[Pair<Near>] {
        self.list.pairs()
    }
}

/// The four particles of two points on segments, and how their difference depends on them:
/// x_b(t) - x_a(s) = Σ weight · x. The weights sum to zero, hence impulses along them keep the momentum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FourPoints {
    pub particles: [usize; 4],
    pub weights: [f64; 4],
}

impl FourPoints {
    #[inline(always)]
    pub fn new(strands: &Strands, i: u32, j: u32, s: f64, t: f64) -> Self {
        let (a, b) = (strands.first_particle(i as usize), strands.first_particle(j as usize));
        Self { particles: [a, a + 1, b, b + 1], weights: [s - 1.0, -s, 1.0 - t, t] }
    }

    /// The second point's value minus the first's.
    #[inline(always)]
    pub fn difference(&self, field: &[Vector3<f64>]) -> Vector3<f64> {
        let [a, b, c, d] = self.particles;
        let w = &self.weights;
        field[a] * w[0] + field[b] * w[1] + field[c] * w[2] + field[d] * w[3]
    }

    /// Change of the difference per impulse on it, 1/g; zero if nothing can move.
    #[inline(always)]
    pub fn inv_mass(&self, inv_mass: &[f64]) -> f64 {
        (0..4).map(|k| self.weights[k] * self.weights[k] * inv_mass[self.particles[k]]).sum()
    }

    /// Adds an impulse (g·cm/s) on the second point, and its opposite on the first, to velocities; with the impulse
    /// times a duration, to positions.
    #[inline(always)]
    pub fn push(&self, inv_mass: &[f64], impulse: &Vector3<f64>, field: &mut [Vector3<f64>]) {
        for k in 0..4 {
            let p = self.particles[k];
            field[p] += impulse * (self.weights[k] * inv_mass[p]);
        }
    }
}

/// Coulomb friction: the impulse that slows `sliding` (relative velocity, normal part taken out) by what `inv_mass`
/// allows, never past zero and never larger than `limit`: the max(1 - μ Δv_N/|v_T|, 0) v_T of Bridson 2002 §7.2.
#[inline(always)]
fn friction_impulse(sliding: &Vector3<f64>, inv_mass: f64, limit: f64) -> Vector3<f64> {
    let speed = sliding.norm();
    if speed <= 0.0 || limit <= 0.0 {
        return Vector3::zeros();
    }
    sliding * (-(speed / inv_mass).min(limit) / speed)
}
