//! A few boxes outside of which the interpolation check surely calls everything free: most ribbons are settled by one look at them.
//!
//! Thin solids are why: half way between two ribbons' rungs a ball says little of a flat comb, a box all there is to say.

use collision::clearance::Standing;
use collision::sdf::{Bounds, SignedDistanceField};
use nalgebra::Vector3;

/// Most boxes of a solid.
const MOST: usize = 64;

/// Pieces of the field, in cells, that boxes are put together from.
const PIECE_CELLS: f32 = 4.0;

/// Boxes of one solid, in its frame, cm: the lower and the upper ends along x, y, z, [`MOST`] or fewer each.
#[derive(Clone, Debug)]
pub(super) struct Occupied {
    all: Bounds,
    low: [Vec<f32>; 3],
    high: [Vec<f32>; 3],
}

impl Occupied {
    pub fn of(sdf: &SignedDistanceField, standing: &Standing) -> Self {
        let mut pieces = Vec::new();
        collect(sdf, standing, sdf.bounds(), &mut pieces);
        // Beyond the grid's faces what is near them counts as near the solid.
        let grid = sdf.bounds();
        for piece in &mut pieces {
            for c in 0..3 {
                if piece.min[c] <= grid.min[c] {
                    piece.min[c] -= standing.surely_free;
                }
                if piece.max[c] >= grid.max[c] {
                    piece.max[c] += standing.surely_free;
                }
            }
        }
        let mut boxes = Vec::new();
        divide(&mut pieces, MOST, &mut boxes);
        let ends = |of: fn(&Bounds) -> Vector3<f32>| [0, 1, 2].map(|c: usize| boxes.iter().map(|b| of(b)[c]).collect());
        Self { all: around(&boxes), low: ends(|b| b.min), high: ends(|b| b.max) }
    }

    /// Distance (cm) of the box around some points from the nearest of the solid's; not positive where they overlap, or where a
    /// point is not finite.
    pub fn distance_from<'a>(&self, points: impl Iterator<Item = &'a Vector3<f32>>) -> f32 {
        let mut around = Bounds::new(Vector3::repeat(f32::INFINITY), Vector3::repeat(f32::NEG_INFINITY));
        let mut sum = 0.0;
        for p in points {
            around = Bounds::new(around.min.inf(p), around.max.sup(p));
            sum += p.x + p.y + p.z;
        }
        if !sum.is_finite() {
            return 0.0;
        }
        let from_all = squared_gap(&around, &self.all);
        // From afar single boxes say little more.
        if from_all > FAR_CM * FAR_CM {
            return from_all.sqrt();
        }
        let mut squared = [0.0; MOST];
        let n = self.low[0].len();
        for c in 0..3 {
            let (from, to) = (around.min[c], around.max[c]);
            for ((squared, low), high) in squared[..n].iter_mut().zip(&self.low[c]).zip(&self.high[c]) {
                let (below, above) = (low - to, from - high);
                let gap = if below > above { below } else { above };
                let gap = if gap > 0.0 { gap } else { 0.0 };
                *squared += gap * gap;
            }
        }
        squared[..n].iter().fold(f32::INFINITY, |least, &s| if s < least { s } else { least }).sqrt()
    }
}

/// From here on (cm) all boxes count as one.
const FAR_CM: f32 = 2.0;

fn squared_gap(a: &Bounds, b: &Bounds) -> f32 {
    let gap = (a.min - b.max).sup(&(b.min - a.max));
    gap.map(|g| g.max(0.0)).norm_squared()
}

/// Pieces of `block` that hold all places where the check may not be sure.
fn collect(sdf: &SignedDistanceField, standing: &Standing, block: Bounds, into: &mut Vec<Bounds>) {
    let size = block.size();
    if standing.budget(block.center(), 0.5 * size.norm()) > 0.0 {
        return;
    }
    let axis = size.imax();
    if size[axis] <= PIECE_CELLS * sdf.cell() {
        into.push(block);
        return;
    }
    let middle = block.center()[axis];
    let (mut low, mut high) = (block, block);
    low.max[axis] = middle;
    high.min[axis] = middle;
    collect(sdf, standing, low, into);
    collect(sdf, standing, high, into);
}

/// Boxes around at most `most` groups of pieces, halved along their longest side.
fn divide(pieces: &mut [Bounds], most: usize, into: &mut Vec<Bounds>) {
    if pieces.is_empty() {
        return;
    }
    let whole = around(pieces);
    let axis = whole.size().imax();
    if most < 2 || pieces.len() < 2 {
        into.push(whole);
        return;
    }
    pieces.sort_unstable_by(|a, b| a.center()[axis].total_cmp(&b.center()[axis]));
    let (low, high) = pieces.split_at_mut(pieces.len() / 2);
    divide(low, most / 2, into);
    divide(high, most / 2, into);
}

fn around(boxes: &[Bounds]) -> Bounds {
    let none = Bounds::new(Vector3::repeat(f32::INFINITY), Vector3::repeat(f32::NEG_INFINITY));
    boxes.iter().fold(none, |all, b| Bounds::new(all.min.inf(&b.min), all.max.sup(&b.max)))
}
