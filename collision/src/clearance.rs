//! The interpolation check of AS16 §4.2: may hairs between two guides be interpolated, or does a solid stand between them?
//!
//! AS16 tests the segments between equal particles of both guides. A departure: the ribbon between two such
//! segments is tested too, for a tooth passes between rung t and rung t + 1 without touching either. All tests bound by the
//! distance at the middle and subdivide; "free" is always proven, so a piece still undecided at the resolution counts as
//! blocked, and so does one that is not finite. [`proven_distance_at`] says what is proven at a place, [`proven_distance`] what a sample proves; the exact tests on the
//! triangles, which these are compared with, are [`crate::surface::Surface::is_hit_by`] and its ribbons.

mod standing;

use nalgebra::Vector3;

use crate::sdf::SignedDistanceField;

pub use standing::Standing;

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
    blocked_place(sdf, corners, clearance, resolution, [0.0, 0.0, 1.0, 1.0], None).is_none()
}

/// Strips of equal width that a rung's ribbon has from one strand to the other, for [`rung_blocked_at`].
pub const STRIPS: usize = 8;

/// The middle of the first piece called blocked, as fractions from `a` to `b` and along, of the patch that is `part` (least and
/// largest of both) of the whole. What is known spares looking at pieces that the check would call free.
fn blocked_place(
    sdf: &SignedDistanceField,
    corners: [Vector3<f32>; 4],
    clearance: f32,
    resolution: f32,
    part: [f32; 4],
    known: Option<(&Standing, u8)>,
) -> Option<[f32; 2]> {
    let [low_u, low_v, high_u, high_v] = part;
    if let Some((standing, free)) = known {
        // Pieces are halves of halves, so one does not reach into a strip that it is not part of.
        let strips = (255 >> (8 - (STRIPS as f32 * high_u).ceil() as u32)) & (255 << (STRIPS as f32 * low_u) as u32);
        if strips & !u32::from(free) == 0 {
            return None;
        }
        let middle = corners.iter().sum::<Vector3<f32>>() * 0.25;
        if standing.budget(middle, farthest(&middle, &corners)) > 0.0 {
            return None;
        }
    }
    let (u, v) = (0.5 * (low_u + high_u), 0.5 * (low_v + high_v));
    match judge_patch(sdf, &corners, clearance, resolution) {
        Verdict::Free => None,
        Verdict::Blocked => Some([u, v]),
        Verdict::Open => {
            let (is_across, [first, second]) = halves(corners);
            let parts = if is_across {
                [[low_u, low_v, u, high_v], [u, low_v, high_u, high_v]]
            } else {
                [[low_u, low_v, high_u, v], [low_u, v, high_u, high_v]]
            };
            blocked_place(sdf, first, clearance, resolution, parts[0], known)
                .or_else(|| blocked_place(sdf, second, clearance, resolution, parts[1], known))
        }
    }
}

/// What one sample says of a bilinear patch, which lies in the hull of its corners.
#[inline]
fn judge_patch(sdf: &SignedDistanceField, corners: &[Vector3<f32>; 4], clearance: f32, resolution: f32) -> Verdict {
    let [a0, b0, a1, b1] = corners;
    let middle = (a0 + b0 + a1 + b1) * 0.25;
    let radius = farthest(&middle, corners);
    judge(sdf, middle, radius, clearance, [resolution, RIBBON_CELLS * sdf.cell()])
}

/// A patch cut across its longer side; whether that is the one from `a` to `b`.
#[inline]
fn halves([a0, b0, a1, b1]: [Vector3<f32>; 4]) -> (bool, [[Vector3<f32>; 4]; 2]) {
    let across = (b0 - a0).norm_squared().max((b1 - a1).norm_squared());
    let along = (a1 - a0).norm_squared().max((b1 - b0).norm_squared());
    if across > along {
        let (m0, m1) = ((a0 + b0) * 0.5, (a1 + b1) * 0.5);
        (true, [[a0, m0, a1, m1], [m0, b0, m1, b1]])
    } else {
        let (ma, mb) = ((a0 + a1) * 0.5, (b0 + b1) * 0.5);
        (false, [[a0, b0, ma, mb], [ma, mb, a1, b1]])
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

/// Where [`strand_ribbon_is_free`] finds the ribbon from `rung` to the next blocked, as fractions from one strand to the other and
/// along; `None` if a bounding ball of rungs that it belongs to dismisses it, or its own test does. The strands' answer is that of
/// all their rungs, in any order. A bit set in `free` says that the check is known to call all of that one of the [`STRIPS`] free; so does what the field's [`Standing`] proves free.
///
/// # Panics
/// If there is no such rung.
pub fn rung_blocked_at(
    sdf: &SignedDistanceField,
    strand_i: &[Vector3<f32>],
    strand_j: &[Vector3<f32>],
    rung: usize,
    resolution: f32,
    (standing, free): (&Standing, u8),
) -> Option<[f32; 2]> {
    let corners = [strand_i[rung], strand_j[rung], strand_i[rung + 1], strand_j[rung + 1]];
    // Most rungs asked for are free by themselves; the balls are looked at only where one is not.
    let place = blocked_place(sdf, corners, 0.0, resolution, [0.0, 0.0, 1.0, 1.0], Some((standing, free)))?;
    (!rung_is_dismissed(sdf, strand_i, strand_j, rung)).then_some(place)
}

/// Whether [`rung_blocked_at`] finds a rung blocked by the piece that holds a given place; if not, another piece may be.
///
/// # Panics
/// If there is no such rung.
pub fn rung_is_blocked_there(
    sdf: &SignedDistanceField,
    strand_i: &[Vector3<f32>],
    strand_j: &[Vector3<f32>],
    (rung, [mut u, mut v]): (usize, [f32; 2]),
    resolution: f32,
) -> bool {
    let mut corners = [strand_i[rung], strand_j[rung], strand_i[rung + 1], strand_j[rung + 1]];
    loop {
        match judge_patch(sdf, &corners, 0.0, resolution) {
            Verdict::Free => return false,
            Verdict::Blocked => return !rung_is_dismissed(sdf, strand_i, strand_j, rung),
            Verdict::Open => {}
        }
        let (is_across, [first, second]) = halves(corners);
        let at = if is_across { &mut u } else { &mut v };
        if *at < 0.5 {
            corners = first;
            *at *= 2.0;
        } else {
            corners = second;
            *at = 2.0 * *at - 1.0;
        }
    }
}

/// Whether a range of rungs that holds `rung` is dismissed by its ball.
fn rung_is_dismissed(
    sdf: &SignedDistanceField,
    strand_i: &[Vector3<f32>],
    strand_j: &[Vector3<f32>],
    rung: usize,
) -> bool {
    let n = strand_i.len().min(strand_j.len());
    assert!(rung + 1 < n, "rung {rung} of {n} particles");
    let (mut low, mut high) = (0, n);
    while high - low > 2 {
        if dismissed(sdf, &strand_i[low..high], &strand_j[low..high], 0.0) {
            return true;
        }
        // As the ranges are halved: the middle rung belongs to both.
        let middle = low + (high - low) / 2;
        if rung < middle {
            high = middle + 1;
        } else {
            low = middle;
        }
    }
    false
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
