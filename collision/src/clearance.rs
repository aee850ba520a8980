//! The interpolation check of AS16 §4.2: may hairs between two guides be interpolated, or does a solid stand between them?
//!
//! AS16 tests the segments between equal particles of both guides. A departure: the ribbon between two such
//! segments is tested too, for a tooth passes between rung t and rung t + 1 without touching either. All tests bound by the
//! distance at the middle and subdivide; "free" is always proven, so a piece still undecided at the resolution counts as
//! blocked, and so does one that is not finite. [`proven_distance_at`] says what is proven at a place, [`proven_distance`] what a sample proves; the exact tests on the
//! triangles, which these are compared with, are [`crate::surface::Surface::is_hit_by`] and its ribbons.

use nalgebra::Vector3;

use crate::sdf::SignedDistanceField;

/// Whether every point of the segment `a`-`b` (solid's frame, cm) is outside the solid. Never true of a segment that is
/// not; may be false of one that passes within a cell and a half of the grid, mostly half of one, however coarse the `resolution`
/// (cm): that says how far pieces are cut that prove nothing, and may be called blocked. Below a sixteenth of a cell it is
/// taken as that.
pub fn segment_is_free(sdf: &SignedDistanceField, a: Vector3<f32>, b: Vector3<f32>, resolution: f32) -> bool {
    segment_keeps_clear(sdf, a, b, 0.0, resolution)
}

/// As [`segment_is_free`], keeping `clearance` cm away; a negative clearance tolerates that much depth.
pub fn segment_keeps_clear(
    sdf: &SignedDistanceField,
    a: Vector3<f32>,
    b: Vector3<f32>,
    clearance: f32,
    resolution: f32,
) -> bool {
    let middle = (a + b) * 0.5;
    let radius = 0.5 * (b - a).norm();
    match judge(sdf, middle, radius, clearance, [resolution, SEGMENT_CELLS * sdf.cell()]) {
        Verdict::Free => true,
        Verdict::Blocked => false,
        Verdict::Open => {
            segment_keeps_clear(sdf, a, middle, clearance, resolution)
                && segment_keeps_clear(sdf, middle, b, clearance, resolution)
        }
    }
}

/// Whether every point of the bilinear patch between the rungs `[a0, b0]` and `[a1, b1]` (solid's frame, cm) is outside
/// the solid: `a` runs along one guide, `b` along the other. As certain as [`segment_is_free`].
pub fn ribbon_is_free(sdf: &SignedDistanceField, corners: [Vector3<f32>; 4], resolution: f32) -> bool {
    ribbon_keeps_clear(sdf, corners, 0.0, resolution)
}

/// As [`ribbon_is_free`], keeping `clearance` cm away; a negative clearance tolerates that much depth.
pub fn ribbon_keeps_clear(
    sdf: &SignedDistanceField,
    corners: [Vector3<f32>; 4],
    clearance: f32,
    resolution: f32,
) -> bool {
    let [a0, b0, a1, b1] = corners;
    // A bilinear patch lies in the hull of its corners.
    let middle = (a0 + b0 + a1 + b1) * 0.25;
    let radius = farthest(&middle, &corners);
    match judge(sdf, middle, radius, clearance, [resolution, RIBBON_CELLS * sdf.cell()]) {
        Verdict::Free => true,
        Verdict::Blocked => false,
        Verdict::Open => {
            let across = (b0 - a0).norm_squared().max((b1 - a1).norm_squared());
            let along = (a1 - a0).norm_squared().max((b1 - b0).norm_squared());
            let halves = if across > along {
                let (m0, m1) = ((a0 + b0) * 0.5, (a1 + b1) * 0.5);
                [[a0, m0, a1, m1], [m0, b0, m1, b1]]
            } else {
                let (ma, mb) = ((a0 + a1) * 0.5, (b0 + b1) * 0.5);
                [[a0, b0, ma, mb], [ma, mb, a1, b1]]
            };
            halves.iter().all(|&half| ribbon_keeps_clear(sdf, half, clearance, resolution))
        }
    }
}

/// Whether the ribbon between two strands (solid's frame, cm, root first) is outside the solid over all their rungs.
/// Strands of unequal count are compared up to the shorter. Ranges of rungs are dismissed by their bounding balls first.
pub fn strand_ribbon_is_free(
    sdf: &SignedDistanceField,
    strand_i: &[Vector3<f32>],
    strand_j: &[Vector3<f32>],
    resolution: f32,
) -> bool {
    strand_ribbon_keeps_clear(sdf, strand_i, strand_j, 0.0, resolution)
}

/// As [`strand_ribbon_is_free`], keeping `clearance` cm away; a negative clearance tolerates that much depth.
pub fn strand_ribbon_keeps_clear(
    sdf: &SignedDistanceField,
    strand_i: &[Vector3<f32>],
    strand_j: &[Vector3<f32>],
    clearance: f32,
    resolution: f32,
) -> bool {
    let n = strand_i.len().min(strand_j.len());
    let (i, j) = (&strand_i[..n], &strand_j[..n]);
    match n {
        0 => true,
        1 => segment_keeps_clear(sdf, i[0], j[0], clearance, resolution),
        2 => ribbon_keeps_clear(sdf, [i[0], j[0], i[1], j[1]], clearance, resolution),
        _ => {
            if dismissed(sdf, i, j, clearance) {
                return true;
            }
            // The middle rung belongs to both halves.
            let m = n / 2;
            strand_ribbon_keeps_clear(sdf, &i[..=m], &j[..=m], clearance, resolution)
                && strand_ribbon_keeps_clear(sdf, &i[m..], &j[m..], clearance, resolution)
        }
    }
}

/// Whether a range of rungs is proven clear by its bounding ball.
fn dismissed(sdf: &SignedDistanceField, i: &[Vector3<f32>], j: &[Vector3<f32>], clearance: f32) -> bool {
    let sum: Vector3<f32> = i.iter().chain(j).sum();
    let middle = sum / (2 * i.len()) as f32;
    let radius = farthest(&middle, i).max(farthest(&middle, j));
    proven_distance(sdf, sdf.distance(middle)) > radius + clearance
}

/// Whether [`strand_ribbon_keeps_clear`], clearance zero, finds nothing at the ribbon from `rung` to the next: by a bounding ball of rungs
/// that it belongs to, or by its own test. The strands' answer is that of all their rungs, in any order.
///
/// # Panics
/// If there is no such rung.
pub fn rung_is_free(
    sdf: &SignedDistanceField,
    strand_i: &[Vector3<f32>],
    strand_j: &[Vector3<f32>],
    rung: usize,
    resolution: f32,
) -> bool {
    let n = strand_i.len().min(strand_j.len());
    assert!(rung + 1 < n, "rung {rung} of {n} particles");
    let corners = [strand_i[rung], strand_j[rung], strand_i[rung + 1], strand_j[rung + 1]];
    // Most rungs asked for are free by themselves; the balls are looked at only where one is not.
    if ribbon_is_free(sdf, corners, resolution) {
        return true;
    }
    let (mut low, mut high) = (0, n);
    while high - low > 2 {
        if dismissed(sdf, &strand_i[low..high], &strand_j[low..high], 0.0) {
            return true;
        }
        let middle = low + (high - low) / 2;
        if rung < middle {
            high = middle + 1;
        } else {
            low = middle;
        }
    }
    false
}

/// What lets a decision of the check stand while things move: how far from the surface a ribbon is surely called free, and how deep
/// a point of it makes it surely blocked.
///
/// The field's underlying distance changes by at most a centimetre a centimetre, and a sample differs from it by at most the mean
/// distance to the nodes it is made of, `sqrt(0.75)` cells. The check calls every piece free in whose middle it proves more than a
/// quarter of a cell; that is so where the distance is more than twice a cell and a little.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Standing {
    /// cm; infinite where the field has too narrow a band of exact nodes to say.
    pub surely_free: f32,
    /// Signed distance (cm) of a sample at or below which the place is inside.
    pub surely_inside: f32,
}

/// `sqrt(0.75)` and a hundredth of a cell for the rounding of stored values.
const SPREAD_CELLS: f32 = 0.88;

/// `SPREAD_CELLS + sqrt(2) * sqrt(0.75 + 1/16)` and a tenth of a cell; the first root because outside the grid a distance is made
/// of two legs.
const SURELY_FREE_CELLS: f32 = 2.3;

impl Standing {
    /// What holds in this field.
    pub fn of(sdf: &SignedDistanceField) -> Self {
        /// Exact nodes that the argument needs, in cells, and what rounding leaves of two.
        const BAND_CELLS: f32 = 1.99;
        let cell = sdf.cell();
        let diagonal = sdf.bounds().size().norm();
        // Stored values are 16 bits of at most the diagonal, rounded down.
        let round_off = 2.0 * sdf.round_off(diagonal) + diagonal / 16384.0;
        let surely_free =
            if sdf.band() >= BAND_CELLS * cell { SURELY_FREE_CELLS * cell + round_off } else { f32::INFINITY };
        Self { surely_free, surely_inside: -SPREAD_CELLS * cell - round_off }
    }

    /// How far (cm) each point of a ball may move before the check might call a ribbon there blocked; not positive where that is not known.
    #[inline]
    pub fn budget(&self, sdf: &SignedDistanceField, middle: Vector3<f32>, radius: f32) -> f32 {
        /// [`SPREAD_CELLS`] for blocks of eight cells.
        const FAR_SPREAD_CELLS: f32 = 7.1;
        let d = sdf.distance(middle);
        let near = d - SPREAD_CELLS * sdf.cell();
        let surely = if near <= sdf.band() { near } else { (d - FAR_SPREAD_CELLS * sdf.cell()).max(sdf.band()) };
        surely - sdf.round_off(d) - radius - self.surely_free
    }
}

enum Verdict {
    Free,
    Blocked,
    Open,
}

/// What a sampled distance `d` (cm) proves about any solid whose nodes were baked with distances that change by at most a
/// centimetre a centimetre: the true distance is at least this, however thin the solid is and wherever it lies between
/// the nodes.
///
/// For a point `c` of the solid, node `n` holds at most `|n - c|`. The weights of a cell have their mean at the point `x`,
/// so by Jensen's inequality the sample is at most `sqrt(|x - c|^2 + V)`, where `V`, the mean of `|n - x|^2`, is at most
/// three quarters of the squared cell. Inside the solid only `d - sqrt(V)` is left. Beyond the band nodes may themselves be
/// means over blocks of eight cells, whose `V` adds.
///
/// [`SignedDistanceField::surely`] takes off an error measured at cell centres instead: tighter along smooth faces, but a
/// figure, not a bound.
#[inline]
pub fn proven_distance(sdf: &SignedDistanceField, d: f32) -> f32 {
    let v = 0.75 * sdf.cell() * sdf.cell();
    let near = less_spread(d, v);
    let proven = if near <= sdf.band() { near } else { less_spread(d, FAR_SPREAD * v).max(sdf.band()) };
    proven - sdf.round_off(d)
}

/// Squares of a cell and of a block of eight, in squared cells.
const FAR_SPREAD: f32 = 65.0;

/// Finest piece worth looking at, in cells: below it a smaller radius proves nothing that matters beside the cell.
const FINEST_CELLS: f32 = 1.0 / 32.0;

#[inline]
fn less_spread(d: f32, v: f32) -> f32 {
    if d * d > v && d > 0.0 { (d * d - v).sqrt() } else { d - v.sqrt() }
}

/// Finest resolutions of pieces whose middle is proven free, in cells: those end at the proof, not at the resolution asked for. A
/// segment has few of them, a ribbon that lies on a face has them all over.
const SEGMENT_CELLS: f32 = 0.125;
const RIBBON_CELLS: f32 = 0.5;

/// [`proven_distance`] beyond this many cells gains nothing from the nodes one by one.
const NEAR_CELLS: f32 = 4.0;

/// What a field proves at a place (solid's frame, cm): the true distance is at least this.
pub fn proven_distance_at(sdf: &SignedDistanceField, p: Vector3<f32>) -> f32 {
    distance_and_proof(sdf, p).1
}

/// Signed distance at a point, and what is proven there: at least [`proven_distance`] of it. Near the surface the cell's eight
/// values tell more than their mean, see [`SignedDistanceField::distance_and_bound2`].
#[inline]
fn distance_and_proof(sdf: &SignedDistanceField, p: Vector3<f32>) -> (f32, f32) {
    let (d, bound2) = sdf.distance_and_bound2(p, NEAR_CELLS * sdf.cell());
    let proven = proven_distance(sdf, d);
    // Where the distance is within the band the nodes are exact, and elsewhere it is more than the band.
    let near = if bound2 > 0.0 { bound2.sqrt().min(sdf.band()) - sdf.round_off(d) } else { proven };
    (d, if near > proven { near } else { proven })
}

/// What one sample in the middle of a piece of the given radius proves. It is cut further down to the first resolution where its
/// middle may be free, and down to the second where it is.
#[inline]
fn judge(
    sdf: &SignedDistanceField,
    middle: Vector3<f32>,
    radius: f32,
    clearance: f32,
    [resolution, if_proven]: [f32; 2],
) -> Verdict {
    let (d, surely) = distance_and_proof(sdf, middle);
    let finest = if surely > clearance && if_proven < resolution { if_proven } else { resolution };
    if surely > radius + clearance {
        Verdict::Free
    } else if d > clearance && radius > (0.5 * finest).max(FINEST_CELLS * sdf.cell()) && radius < f32::INFINITY {
        Verdict::Open
    } else {
        Verdict::Blocked
    }
}

fn farthest(middle: &Vector3<f32>, points: &[Vector3<f32>]) -> f32 {
    // Not a number must not be lost in a maximum: such a piece is blocked.
    let largest = points.iter().map(|p| (p - middle).norm_squared()).fold(0.0, |a: f32, b| if b <= a { a } else { b });
    largest.sqrt()
}
