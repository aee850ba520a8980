//! What lets a decision of the interpolation check stand while things move: how far from the surface a ribbon is surely called
//! free, and how deep a point of it makes it surely blocked.
//!
//! The field's underlying distance changes by at most a centimetre a centimetre, and a sample differs from it by at most the mean
//! distance to the nodes it is made of, `sqrt(0.75)` cells. The check calls every piece free in whose middle it proves more than a
//! quarter of a cell; that is so where the distance is more than twice a cell and a little. Lower bounds of it are kept on a grid
//! small enough for a cache: asked for far more often than the field itself, they need not be as good.

use crate::sdf::SignedDistanceField;
use nalgebra::Vector3;

/// `sqrt(0.75)` and a hundredth of a cell for the rounding of stored values.
const SPREAD_CELLS: f32 = 0.88;

/// [`SPREAD_CELLS`] for blocks of eight cells.
const FAR_SPREAD_CELLS: f32 = 7.1;

/// `SPREAD_CELLS + sqrt(2) * sqrt(0.75 + 1/16)` and a tenth of a cell; the first root because outside the grid a distance is made
/// of two legs.
const SURELY_FREE_CELLS: f32 = 2.3;

/// Exact nodes around the surface that the argument needs, in cells, and what rounding leaves of two.
const BAND_CELLS: f32 = 1.99;

/// Most values kept, about.
const VALUES: f32 = 524_288.0;

/// Bounds for one field; see the module.
#[derive(Clone, Debug)]
pub struct Standing {
    /// Distance (cm) from which on the check surely calls a ribbon free; infinite where the field has too narrow a band of exact
    /// nodes to say.
    pub surely_free: f32,
    /// Signed distance (cm) of a sample at or below which the place is inside.
    pub surely_inside: f32,
    origin: Vector3<f32>,
    spacing: f32,
    per_spacing: f32,
    nodes: [usize; 3],
    /// Largest coordinates in spacings.
    last: [f32; 3],
    /// Lower bounds of the distance at the nodes, x fastest, cm.
    values: Vec<f32>,
}

impl Standing {
    /// What holds in this field. Samples it some hundred thousand times.
    pub fn of(sdf: &SignedDistanceField) -> Self {
        let (cell, bounds) = (sdf.cell(), sdf.bounds());
        let size = bounds.size();
        // Stored values are 16 bits of at most the diagonal, rounded down.
        let round_off = 2.0 * sdf.round_off(size.norm()) + size.norm() / 16384.0;
        let surely_free =
            if sdf.band() >= BAND_CELLS * cell { SURELY_FREE_CELLS * cell + round_off } else { f32::INFINITY };
        let spacing = (size.product() / VALUES).cbrt().max(2.0 * cell);
        let nodes = [0, 1, 2].map(|c: usize| (size[c] / spacing).ceil() as usize + 1);
        let mut values = Vec::with_capacity(nodes.iter().product());
        for k in 0..nodes[2] {
            for j in 0..nodes[1] {
                for i in 0..nodes[0] {
                    let p = bounds.min + Vector3::new(i as f32, j as f32, k as f32) * spacing;
                    values.push(bound(sdf, p));
                }
            }
        }
        let surely_inside = -SPREAD_CELLS * cell - round_off;
        Self {
            surely_free,
            surely_inside,
            origin: bounds.min,
            spacing,
            per_spacing: 1.0 / spacing,
            last: nodes.map(|n| (n - 1) as f32),
            nodes,
            values,
        }
    }

    /// How far (cm) each point of a ball (solid's frame) may move before the check might call a ribbon there blocked; not positive
    /// where that is not known.
    #[inline]
    pub fn budget(&self, middle: Vector3<f32>, radius: f32) -> f32 {
        let g = (middle - self.origin) * self.per_spacing;
        let mut at = 0;
        let (mut from_node, mut gap) = (0.0, 0.0);
        for c in [2, 1, 0] {
            let held = if g[c] > 0.0 { g[c].min(self.last[c]) } else { 0.0 };
            let node = (held + 0.5) as u32 as usize;
            at = at * self.nodes[c] + node;
            let (a, b) = (held - node as f32, g[c] - held);
            from_node += a * a;
            gap += b * b;
        }
        let at_held = self.values[at] - from_node.sqrt() * self.spacing;
        // Every point of the solid has an obtuse angle at the nearest point of the box around it. A gap is not a number where the
        // place is not one.
        let bound = if gap == 0.0 {
            at_held
        } else {
            let held = at_held.max(0.0);
            (gap * self.spacing * self.spacing + held * held).sqrt()
        };
        bound - radius - self.surely_free
    }
}

/// Lower bound of a field's underlying distance at a place, cm.
fn bound(sdf: &SignedDistanceField, p: Vector3<f32>) -> f32 {
    let d = sdf.distance(p);
    let near = d - SPREAD_CELLS * sdf.cell();
    let bound = if near <= sdf.band() { near } else { (d - FAR_SPREAD_CELLS * sdf.cell()).max(sdf.band()) };
    bound - sdf.round_off(d)
}
