//! Which hairs may touch, by cutting all of them with planes: a search whose cost grows with the hairs, not with their
//! boxes.
//!
//! Hair in contact is mostly parallel, and a segment is a hundred times longer than hair is thick: boxes around segments
//! overlap hundreds of others for every true contact. Planes at a spacing cut each segment in a point or two; points of one
//! plane that lie near each other name the pairs, and the slopes of both segments tell how near these come between this
//! plane and the next. What lies along each other is found by every plane it crosses; hairs that cross at an angle are found
//! if a plane happens to pass near the crossing, and hardly ever if they cross squarely. Planes shift from search to search
//! (docs/DEVIATIONS.md). Invariant: a pair is named once, at most the nearest few for each cut, and the result depends on
//! nothing but positions and parameters.

use super::Strands;
use super::blocks::{BLOCKS, Blocks};
use crate::error::Error;
use multiversion::multiversion;
use nalgebra::Vector3;
use rayon::prelude::*;

/// Pieces of strands that are cut in parallel, and groups of planes that are searched in parallel; fixed, so that results
/// do not depend on the thread count.
const PIECES: usize = 64;
const GROUPS: usize = 64;

/// Smallest component along an axis, as a share of the length, of a segment cut across it. Below 1/√3, so that each is cut
/// across one axis at least, by enough for neighbours some degrees apart to be cut across the same one.
const LEAST_ACROSS: f64 = 0.5;

/// Planes on either side of zero.
const MOST_PLANES: f64 = 1e6;

/// Most contacts kept for a cut.
pub const MAX_CONTACTS: usize = 16;

/// Which contacts of hair with hair are looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactSampling {
    /// Distance between planes, cm.
    pub spacing_cm: f64,
    /// How far two cuts of one plane may lie apart, as a multiple of the hair's thickness; at least 2, or parallel hairs in
    /// contact may be missed.
    pub window: f64,
    /// Contacts kept for each cut at most, the nearest ones; 16 at most.
    pub max_contacts: usize,
}

impl ContactSampling {
    /// Planes half a segment of a 25 cm hair apart, a window of three thicknesses, four contacts.
    #[must_use]
    pub fn standard() -> Self {
        Self { spacing_cm: 0.5, window: 3.0, max_contacts: 4 }
    }

    /// Checks every constant.
    ///
    /// # Errors
    /// [`Error::BadInteraction`] naming the first constant out of range.
    pub fn validate(&self) -> Result<(), Error> {
        let bad = |name, value, expected| Err(Error::BadInteraction { name, value, expected });
        if !(self.spacing_cm > 0.0 && self.spacing_cm.is_finite()) {
            return bad("spacing_cm", self.spacing_cm, "positive and finite");
        }
        if !(self.window >= 2.0 && self.window.is_finite()) {
            return bad("window", self.window, "finite and at least 2");
        }
        if !(1..=MAX_CONTACTS).contains(&self.max_contacts) {
            return bad("max_contacts", self.max_contacts as f64, "between 1 and 16");
        }
        Ok(())
    }
}

/// Where a plane cuts a segment.
#[derive(Clone, Copy, Debug, Default)]
struct Cut {
    /// Place in the plane, cm.
    place: [f32; 2],
    /// What the place moves by, per centimetre across the plane.
    slope: [f32; 2],
    /// Component of the segment's direction across the plane, 0 to 1.
    across: f32,
    /// Where the segment begins below the plane, cm; not positive.
    low: f32,
    segment: u32,
    row: u32,
}

/// Planes and windows of one search.
#[derive(Clone, Copy, Debug)]
struct Slicing {
    spacing: f64,
    /// Place of the plane numbered zero on each axis, cm.
    offset: f64,
    window: f32,
    reach: f32,
    max_contacts: usize,
}

/// What one group of planes is searched in.
#[derive(Clone, Debug, Default)]
struct GroupWork {
    cuts: Vec<Cut>,
}

/// Buffers of a search, kept from step to step.
#[derive(Clone, Debug, Default)]
pub struct SliceSearch {
    /// Cuts by piece, then group.
    pieces: Vec<Vec<Vec<Cut>>>,
    groups: Vec<GroupWork>,
}

impl SliceSearch {
    /// Names pairs of segments that may come within `reach_cm` of each other, by blocks of strands.
    pub fn find(&mut self, strands: &Strands, reach_cm: f64, sampling: &ContactSampling, found: &mut Blocks) {
        let slicing = Slicing {
            spacing: sampling.spacing_cm,
            offset: sampling.spacing_cm * scatter(strands.position),
            window: (sampling.window * reach_cm) as f32,
            reach: reach_cm as f32,
            max_contacts: sampling.max_contacts.min(MAX_CONTACTS),
        };
        found.prepare(GROUPS);
        if slicing.window <= 0.0 {
            return;
        }
        self.cut(strands, &slicing);
        let pieces = &self.pieces;
        self.groups.resize_with(GROUPS, GroupWork::default);
        let groups = self.groups.par_iter_mut().zip(&mut found.lists).enumerate().with_max_len(1);
        groups.for_each(|(group, (work, lists))| work.search(pieces, group, strands, &slicing, lists));
    }

    fn cut(&mut self, strands: &Strands, slicing: &Slicing) {
        self.pieces.resize_with(PIECES, || vec![Vec::new(); GROUPS]);
        let n = strands.n_segments();
        let share = n.div_ceil(PIECES);
        self.pieces.par_iter_mut().enumerate().with_max_len(1).for_each(|(piece, groups)| {
            groups.iter_mut().for_each(Vec::clear);
            for segment in (piece * share).min(n)..((piece + 1) * share).min(n) {
                slicing.cut(strands, segment, groups);
            }
        });
    }
}

/// A number from 0 to 1 that follows from where some of the hair is, and so differs from step to step: planes placed by it
/// need no counter kept beside the state.
fn scatter(position: &[Vector3<f64>]) -> f64 {
    const SAMPLES: usize = 64;
    let stride = position.len().div_ceil(SAMPLES).max(1);
    let mut bits = 0_u64;
    for x in position.iter().skip(stride - 1).step_by(stride) {
        bits = (bits ^ x.y.to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        bits ^= bits >> 29;
    }
    (bits >> 11) as f64 / (1_u64 << 53) as f64
}

impl Slicing {
    /// Adds the cuts of a segment to the groups of their planes.
    #[inline]
    fn cut(&self, strands: &Strands, segment: usize, groups: &mut [Vec<Cut>]) {
        let [a, b] = strands.segment(segment);
        let d = b - a;
        let length = d.norm();
        if !(length > 0.0 && (a.sum() + b.sum()).is_finite()) {
            return;
        }
        for axis in 0..3 {
            let across = d[axis].abs() / length;
            if across < LEAST_ACROSS {
                continue;
            }
            let [u, v] = in_plane(axis);
            let slope = [d[u] / d[axis], d[v] / d[axis]];
            let (low, high) = (a[axis].min(b[axis]), a[axis].max(b[axis]));
            let mut plane = ((low - self.offset) / self.spacing).ceil();
            // Beyond this lies no hair that is still of use, nor would planes be told from each other.
            if plane.abs() > MOST_PLANES || high - low > MOST_PLANES * self.spacing {
                return;
            }
            loop {
                let at = self.offset + plane * self.spacing;
                if at >= high {
                    break;
                }
                let beyond = at - a[axis];
                let place = [(a[u] + slope[0] * beyond) as f32, (a[v] + slope[1] * beyond) as f32];
                let number = (plane as i64 as u32).wrapping_add((GROUPS / 3 * axis) as u32);
                groups[number as usize % GROUPS].push(Cut {
                    place,
                    slope: slope.map(|x| x as f32),
                    across: across as f32,
                    low: (low - at) as f32,
                    segment: segment as u32,
                    row: row_of(axis, plane as i64, (place[1] / self.window).floor() as i32),
                });
                plane += 1.0;
            }
        }
    }

    /// Squared distance that two segments come within between half a spacing below the plane and half above, never more
    /// than their true one there; none if it exceeds the reach, or their cuts the window.
    #[inline(always)]
    fn approach(&self, a: &Cut, b: &Cut, apart: [f32; 2]) -> Option<f32> {
        if apart[0].abs() > self.window || apart[1].abs() > self.window {
            return None;
        }
        let turn = [b.slope[0] - a.slope[0], b.slope[1] - a.slope[1]];
        let turn2 = turn[0] * turn[0] + turn[1] * turn[1];
        let half = 0.5 * self.spacing as f32;
        let along = -(apart[0] * turn[0] + apart[1] * turn[1]);
        // Without a division where lines are parallel: then any place is as near.
        let up = if along.abs() >= half * turn2 { half.copysign(along) } else { along / turn2 };
        let near = [apart[0] + turn[0] * up, apart[1] + turn[1] * up];
        // Of an offset in the plane, a line that leaves the plane takes away no more than this.
        let least = a.across.max(b.across);
        let distance2 = (near[0] * near[0] + near[1] * near[1]) * least * least;
        (distance2 <= self.reach * self.reach).then_some(distance2)
    }

    /// As [`Self::approach`], of pairs that this plane is to name: not those that the plane below has found already, nor
    /// those that another axis suits better.
    #[inline(always)]
    fn names(&self, a: &Cut, b: &Cut) -> Option<f32> {
        let apart = [b.place[0] - a.place[0], b.place[1] - a.place[1]];
        let distance2 = self.approach(a, b, apart)?;
        let spacing = self.spacing as f32;
        if a.low <= -spacing && b.low <= -spacing {
            let below = [0, 1].map(|k| apart[k] - (b.slope[k] - a.slope[k]) * spacing);
            if self.approach(a, b, below).is_some() {
                return None;
            }
        }
        let least = LEAST_ACROSS as f32;
        let other_suits = |k: usize| {
            let (on_a, on_b) = (a.across * a.slope[k].abs(), b.across * b.slope[k].abs());
            on_a >= least && on_b >= least && on_a + on_b > a.across + b.across
        };
        (!other_suits(0) && !other_suits(1)).then_some(distance2)
    }
}

#[inline(always)]
fn in_plane(axis: usize) -> [usize; 2] {
    [(axis + 1) % 3, (axis + 2) % 3]
}

/// Names a strip of a plane, next to each other in ascending order; those named alike are metres apart, and the distance
/// tells them from each other.
#[inline(always)]
fn row_of(axis: usize, plane: i64, strip: i32) -> u32 {
    (axis as u32) << 30 | (plane as u32 & 0xfff) << 18 | (strip.wrapping_add(0x2_0000) as u32 & 0x3_ffff)
}

impl Cut {
    /// Strip by strip, then along it.
    #[inline(always)]
    fn order(&self) -> u64 {
        // Of finite numbers: negative ones descend with their bits.
        let bits = self.place[0].to_bits();
        let ascending = if bits >> 31 == 0 { bits | 1 << 31 } else { !bits };
        u64::from(self.row) << 32 | u64::from(ascending)
    }
}

impl GroupWork {
    fn search(
        &mut self,
        pieces: &[Vec<Vec<Cut>>],
        group: usize,
        strands: &Strands,
        slicing: &Slicing,
        lists: &mut [Vec<[u32; 2]>],
    ) {
        let Self { cuts } = self;
        cuts.clear();
        pieces.iter().for_each(|groups| cuts.extend_from_slice(&groups[group]));
        cuts.sort_unstable_by_key(Cut::order);
        let mut begin = 0;
        while begin < cuts.len() {
            let end = begin + cuts[begin..].partition_point(|cut| cut.row == cuts[begin].row);
            let above = cuts[end..].partition_point(|cut| cut.row == cuts[begin].row + 1);
            search_strip(&cuts[begin..end], &cuts[end..end + above], strands, slicing, lists);
            begin = end;
        }
    }
}

/// Names the pairs of a strip's cuts with each other and with those of the strip above, nearest first.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn search_strip(strip: &[Cut], above: &[Cut], strands: &Strands, slicing: &Slicing, lists: &mut [Vec<[u32; 2]>]) {
    let per_block = Blocks::segments_per_block(strands);
    let mut nearest = Nearest::default();
    let mut first_above = 0;
    for (k, cut) in strip.iter().enumerate() {
        nearest.n = 0;
        while first_above < above.len() && above[first_above].place[0] < cut.place[0] - slicing.window {
            first_above += 1;
        }
        for others in [&strip[k + 1..], &above[first_above..]] {
            for other in others {
                if other.place[0] > cut.place[0] + slicing.window {
                    break;
                }
                if let Some(distance2) = slicing.names(cut, other)
                    && strands.are_apart(cut.segment as usize, other.segment as usize)
                {
                    nearest.offer(distance2, other.segment, slicing.max_contacts);
                }
            }
        }
        for &(_, other) in &nearest.found[..nearest.n] {
            let (i, j) = (cut.segment.min(other), cut.segment.max(other));
            lists[i as usize / per_block * BLOCKS + j as usize / per_block].push([i, j]);
        }
    }
}

/// The nearest few so far, ascending.
#[derive(Default)]
struct Nearest {
    found: [(f32, u32); MAX_CONTACTS],
    n: usize,
}

impl Nearest {
    #[inline(always)]
    fn offer(&mut self, distance2: f32, segment: u32, most: usize) {
        let new = (distance2, segment);
        if self.n == most {
            if self.found[most - 1] <= new {
                return;
            }
        } else {
            self.n += 1;
        }
        let mut at = self.n - 1;
        while at > 0 && new < self.found[at - 1] {
            self.found[at] = self.found[at - 1];
            at -= 1;
        }
        self.found[at] = new;
    }
}
