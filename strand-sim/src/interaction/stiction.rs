//! Stiction: hairs that came close hold on to each other by springs between points on their segments (MS08 §5.2).
//!
//! A link is made where two segments come nearer than a distance, keeps its two points, and lasts until it is longer than
//! another distance; force plays no part in breaking it. At most a given number of links hang on a segment: those it has
//! stay, and the free places go to the closest new partners. Invariant: links are sorted by segment pair, one per pair,
//! and no segment carries more than its number.

use super::{FourPoints, Near, Strands};
use crate::error::Error;
use collision::spatial_hash::Pair;
use nalgebra::Vector3;
use rayon::prelude::*;

/// Most links on a segment; heaps of this size are kept for every segment.
pub const MAX_LINKS: usize = 16;

/// Links handled as one piece of parallel work.
const CHUNK: usize = 1024;

/// Shortest link that still has a direction of its own, cm.
const SHORTEST_CM: f64 = 1e-9;

/// How hair sticks to hair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StictionParams {
    /// Segments nearer than this are linked, cm.
    pub make_cm: f64,
    /// Links longer than this are dropped, cm.
    pub break_cm: f64,
    /// Links on one segment at most.
    pub max_links: usize,
    /// Rest length of a link (the paper's ε), cm.
    pub rest_cm: f64,
    /// Force at strain one, dyn.
    pub stiffness: f64,
    /// Damping along the link, dyn·s/cm.
    pub damping: f64,
    /// What the hair weighs as a multiple of its dry mass; for the caller to apply to the masses.
    pub mass_factor: f64,
}

/// What a user says about hair; each from 0 to 1, values outside are clamped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HairStyle {
    /// Wet hair sticks twenty times harder and weighs twice as much.
    pub wetness: f64,
    /// Clumped hair holds on to up to six more partners, three times harder.
    pub clumpiness: f64,
    /// Voluminous hair has links of up to three times the length; their stiffness per length stays.
    pub volume: f64,
}

impl StictionParams {
    /// No stiction.
    #[must_use]
    pub fn off() -> Self {
        Self { max_links: 0, ..Self::dry() }
    }

    /// Dry, loose hair: two links a segment, each giving way at a pull of a tenth of a dyne, the weight of two
    /// centimetres of hair.
    #[must_use]
    pub fn dry() -> Self {
        Self::from_style(&HairStyle { wetness: 0.0, clumpiness: 0.0, volume: 0.0 })
    }

    /// Soaked hair in clumps.
    #[must_use]
    pub fn wet() -> Self {
        Self::from_style(&HairStyle { wetness: 1.0, clumpiness: 0.5, volume: 0.0 })
    }

    /// Parameters of a style.
    /// Implements MS08 §5.2: wetness by more stickiness and mass, clumps by number and stiffness of connections, volume
    /// by rest length and stiffness.
    #[must_use]
    pub fn from_style(style: &HairStyle) -> Self {
        let [wetness, clumpiness, volume] =
            [style.wetness, style.clumpiness, style.volume].map(|x| if x > 0.0 { x.min(1.0) } else { 0.0 });
        let rest_cm = 0.06 * (1.0 + 2.0 * volume);
        let stiffness_per_cm = 0.1 / 0.06 * (1.0 + 19.0 * wetness) * (1.0 + 2.0 * clumpiness);
        Self {
            make_cm: rest_cm + 0.02,
            break_cm: 2.0 * rest_cm,
            max_links: 2 + (6.0 * clumpiness).round() as usize,
            rest_cm,
            stiffness: stiffness_per_cm * rest_cm,
            // A quarter of critical for two points of half a centimetre of hair each.
            damping: 0.5 * (stiffness_per_cm * 1.25e-5).sqrt(),
            mass_factor: 1.0 + wetness,
        }
    }

    /// Checks every constant.
    ///
    /// # Errors
    /// [`Error::BadInteraction`] naming the first constant out of range.
    pub fn validate(&self) -> Result<(), Error> {
        let bad = |name, value, expected| Err(Error::BadInteraction { name, value, expected });
        for (name, value) in [("make_cm", self.make_cm), ("rest_cm", self.rest_cm), ("mass_factor", self.mass_factor)] {
            if !(value > 0.0 && value.is_finite()) {
                return bad(name, value, "positive and finite");
            }
        }
        for (name, value) in [("stiffness", self.stiffness), ("damping", self.damping)] {
            if !(value >= 0.0 && value.is_finite()) {
                return bad(name, value, "finite and not negative");
            }
        }
        if !(self.break_cm >= self.make_cm && self.break_cm.is_finite()) {
            return bad(
                "break_cm",
                self.break_cm,
                "finite and at least make_cm, or links would break as they are made",
            );
        }
        if self.max_links > MAX_LINKS {
            return bad("max_links", self.max_links as f64, "at most 16");
        }
        Ok(())
    }
}

/// Two segments that stick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Link {
    /// Lower segment.
    pub i: u32,
    /// Higher segment.
    pub j: u32,
    /// Place held on the first segment, 0 at its root end.
    pub s: f64,
    /// Place held on the second.
    pub t: f64,
    /// Direction of the link when it last had one, for the moment its points coincide.
    direction: Vector3<f64>,
}

/// A link as the linear solve sees it: the rank-one spring of MS08 §4.1 between four particles.
///
/// With u = Σ weightₖ direction·vₖ, the force on particle k is -weightₖ direction (tension + (dt·stiffness_per_cm +
/// damping) u), u taken at the new velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkSpring {
    /// Particles: both ends of the first segment, both of the second.
    pub particles: [u32; 4],
    /// Weight of each; they sum to zero.
    pub weights: [f64; 4],
    /// Unit vector from the first point to the second, frozen.
    pub direction: Vector3<f64>,
    /// Force at the positions given, dyn; negative pushes.
    pub tension: f64,
    /// Elastic force per length, dyn/cm.
    pub stiffness_per_cm: f64,
    /// Damping along the direction, dyn·s/cm.
    pub damping: f64,
}

impl LinkSpring {
    /// Impulse per relative velocity over an implicit step of `dt`, g: the factor of (w⊗d)(w⊗d)ᵀ in the matrix.
    #[inline(always)]
    #[must_use]
    pub fn coefficient(&self, dt: f64) -> f64 {
        dt * (dt * self.stiffness_per_cm + self.damping)
    }
}

/// What an update did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkReport {
    /// Links dropped as too long.
    pub broken: usize,
    /// Links made.
    pub made: usize,
    /// Links held afterwards.
    pub held: usize,
}

/// A candidate waiting for one of a segment's places.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Waiting {
    distance2: f64,
    candidate: u32,
}

impl Waiting {
    /// Ties go to the lower pair, so that the order is total.
    #[inline(always)]
    fn is_farther(&self, other: &Self) -> bool {
        (self.distance2, self.candidate) > (other.distance2, other.candidate)
    }
}

/// Buffers of an update, kept from step to step.
#[derive(Clone, Debug, Default)]
pub struct StictionWorkspace {
    /// `max_links` places a segment: a max-heap of the closest candidates so far.
    heap: Vec<Waiting>,
    n_waiting: Vec<u8>,
    n_held: Vec<u8>,
    /// Of its two segments, how many gave the candidate a place.
    votes: Vec<u8>,
}

/// The links of a set of strands: state, to be kept with positions and velocities.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LinkSet {
    /// Ascending by (i, j).
    links: Vec<Link>,
    /// First link of each segment, as the lower one of its pair; one more than there are segments.
    first: Vec<u32>,
}

impl LinkSet {
    /// The links, ascending by segment pair.
    #[must_use]
    pub fn links(&self) -> &[Link] {
        &self.links
    }

    /// Whether two segments, the lower first, are linked.
    #[inline]
    #[must_use]
    pub fn is_linked(&self, i: usize, j: usize) -> bool {
        let (Some(&begin), Some(&end)) = (self.first.get(i), self.first.get(i + 1)) else { return false };
        self.links[begin as usize..end as usize].iter().any(|link| link.j as usize == j)
    }

    /// Drops every link.
    pub fn clear(&mut self) {
        self.links.clear();
        self.first.clear();
    }

    /// Drops the links that have grown too long and makes new ones among the near pairs.
    ///
    /// A pair is linked when both its segments have it among the closest for their free places. A place that a segment
    /// keeps for a partner which has none for it stays free until the next update.
    /// Implements MS08 §5.2: segment pairs under a distance, the n closest of a segment kept in a max heap, links held
    /// until longer than the separation threshold.
    pub fn update(
        &mut self,
        strands: &Strands,
        near: &[Pair<Near>],
        params: &StictionParams,
        workspace: &mut StictionWorkspace,
    ) -> LinkReport {
        let broken = self.release(strands, params);
        LinkReport { broken, ..self.renew(strands, near, params, workspace) }
    }

    /// Makes new links among the near pairs: the second half of [`Self::update`], after [`Self::release`] at the same
    /// positions.
    pub fn renew(
        &mut self,
        strands: &Strands,
        near: &[Pair<Near>],
        params: &StictionParams,
        workspace: &mut StictionWorkspace,
    ) -> LinkReport {
        let kept = self.links.len();
        let max_links = params.max_links.min(MAX_LINKS);
        if max_links > 0 {
            self.make(strands, near, params.make_cm, max_links, workspace);
        }
        LinkReport { broken: 0, made: self.links.len() - kept, held: self.links.len() }
    }

    /// Drops the links that have grown too long, and returns how many: the first half of [`Self::update`], for who wants
    /// to know what there is room for before looking.
    pub fn release(&mut self, strands: &Strands, params: &StictionParams) -> usize {
        let before = self.links.len();
        let break2 = params.break_cm * params.break_cm;
        if params.max_links == 0 {
            self.links.clear();
        }
        self.links.retain(|link| {
            let points = FourPoints::new(strands, link.i, link.j, link.s, link.t);
            points.difference(strands.position).norm_squared() <= break2
        });
        self.index(strands.n_segments());
        before - self.links.len()
    }

    fn make(
        &mut self,
        strands: &Strands,
        near: &[Pair<Near>],
        make_cm: f64,
        max_links: usize,
        workspace: &mut StictionWorkspace,
    ) {
        let n_segments = strands.n_segments();
        let StictionWorkspace { heap, n_waiting, n_held, votes } = workspace;
        n_held.clear();
        n_held.resize(n_segments, 0);
        n_waiting.clear();
        n_waiting.resize(n_segments, 0);
        heap.resize(n_segments * max_links, Waiting::default());
        votes.clear();
        votes.resize(near.len(), 0);
        for link in &self.links {
            n_held[link.i as usize] += 1;
            n_held[link.j as usize] += 1;
        }
        for (candidate, pair) in near.iter().enumerate() {
            let (i, j) = (pair.i as usize, pair.j as usize);
            let distance2 = pair.data.offset.norm_squared();
            let room = |segment: usize| max_links.saturating_sub(n_held[segment] as usize);
            // Where one side has no place at all, the other need not keep one.
            if distance2 >= make_cm * make_cm || room(i) == 0 || room(j) == 0 || self.is_linked(i, j) {
                continue;
            }
            let waiting = Waiting { distance2, candidate: candidate as u32 };
            for segment in [i, j] {
                let places = &mut heap[segment * max_links..][..room(segment)];
                offer(places, &mut n_waiting[segment], waiting);
            }
        }
        for (segment, &n) in n_waiting.iter().enumerate() {
            for waiting in &heap[segment * max_links..][..n as usize] {
                votes[waiting.candidate as usize] += 1;
            }
        }
        let kept = self.links.len();
        for (pair, &votes) in near.iter().zip(votes.iter()) {
            if votes == 2 {
                let direction = pair.data.offset.try_normalize(SHORTEST_CM);
                let direction = direction.unwrap_or_else(|| across(strands, pair.i, pair.j));
                self.links.push(Link { i: pair.i, j: pair.j, s: pair.data.s, t: pair.data.t, direction });
            }
        }
        if self.links.len() > kept {
            self.links.par_sort_unstable_by_key(|link| (link.i, link.j));
            self.index(n_segments);
        }
    }

    fn index(&mut self, n_segments: usize) {
        self.first.clear();
        self.first.resize(n_segments + 1, 0);
        for link in &self.links {
            self.first[link.i as usize + 1] += 1;
        }
        for segment in 0..n_segments {
            self.first[segment + 1] += self.first[segment];
        }
    }

    /// The links as springs at the positions given, in their order. The directions are remembered for a later moment
    /// when the points of a link coincide.
    /// Implements MS08 §5.2: a spring of rest length ε between two embedded nodes, linear as in §4.1.
    pub fn springs(&mut self, strands: &Strands, params: &StictionParams, out: &mut Vec<LinkSpring>) {
        let stiffness_per_cm = params.stiffness / params.rest_cm;
        self.links
            .par_iter_mut()
            .with_min_len(CHUNK)
            .map(|link| {
                let points = FourPoints::new(strands, link.i, link.j, link.s, link.t);
                let offset = points.difference(strands.position);
                let length = offset.norm();
                if length > SHORTEST_CM {
                    link.direction = offset / length;
                }
                LinkSpring {
                    particles: points.particles.map(|p| p as u32),
                    weights: points.weights,
                    direction: link.direction,
                    tension: stiffness_per_cm * (length - params.rest_cm),
                    stiffness_per_cm,
                    damping: params.damping,
                }
            })
            .collect_into_vec(out);
    }
}

/// A direction square to both segments, for two that cross at a point.
fn across(strands: &Strands, i: u32, j: u32) -> Vector3<f64> {
    let (a, b) = (strands.segment(i as usize), strands.segment(j as usize));
    let (u, v) = (a[1] - a[0], b[1] - b[0]);
    let any = if u.x.abs() < u.y.abs() { Vector3::x() } else { Vector3::y() };
    let cross = u.cross(&v).try_normalize(SHORTEST_CM * SHORTEST_CM);
    cross.or_else(|| u.cross(&any).try_normalize(SHORTEST_CM)).unwrap_or_else(Vector3::x)
}

/// Offers a candidate to a heap of fixed size with the farthest on top: it takes a free place, or that of the farthest.
fn offer(places: &mut [Waiting], n_waiting: &mut u8, new: Waiting) {
    let mut at = *n_waiting as usize;
    if at < places.len() {
        *n_waiting += 1;
        while at > 0 && new.is_farther(&places[(at - 1) / 2]) {
            places[at] = places[(at - 1) / 2];
            at = (at - 1) / 2;
        }
        places[at] = new;
        return;
    }
    if places.is_empty() || !places[0].is_farther(&new) {
        return;
    }
    at = 0;
    loop {
        let mut child = 2 * at + 1;
        if child >= places.len() {
            break;
        }
        if child + 1 < places.len() && places[child + 1].is_farther(&places[child]) {
            child += 1;
        }
        if !places[child].is_farther(&new) {
            break;
        }
        places[at] = places[child];
        at = child;
    }
    places[at] = new;
}
