//! A signed distance field on a grid that is fine near the surface, sampled by trilinear interpolation (AS16 §5.1).
//!
//! Sampling is the hot path of the whole program: one look at the table of bricks, eight reads at fixed places of one
//! cache line, no branch but the one that asks whether the point is in the grid. Outside the grid the answer stays a lower bound of the distance: with `q`
//! the nearest point of the box, every point `c` of the solid has an obtuse angle at `q`, so
//! `|p - c|^2 >= |p - q|^2 + |q - c|^2`. That bound joins the interpolant continuously at the faces.

use std::sync::atomic::{AtomicU64, Ordering};

use nalgebra::Vector3;

use crate::error::Error;
use crate::sdf::bricks::{BRICK, COARSE, Layout, first_corner};

/// An axis-aligned box, cm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Smallest corner.
    pub min: Vector3<f32>,
    /// Largest corner.
    pub max: Vector3<f32>,
}

impl Bounds {
    /// The box between two corners.
    pub fn new(min: Vector3<f32>, max: Vector3<f32>) -> Self {
        Self { min, max }
    }

    /// The smallest box around `points`; `None` when there are none.
    pub fn around(points: &[[f32; 3]]) -> Option<Self> {
        let first = Vector3::from(*points.first()?);
        Some(points.iter().fold(Self::new(first, first), |b, p| {
            let p = Vector3::from(*p);
            Self::new(b.min.inf(&p), b.max.sup(&p))
        }))
    }

    /// The box grown by `margin` cm on every side.
    #[must_use]
    pub fn grown(&self, margin: f32) -> Self {
        let m = Vector3::repeat(margin);
        Self::new(self.min - m, self.max + m)
    }

    /// Edge lengths, cm.
    pub fn size(&self) -> Vector3<f32> {
        self.max - self.min
    }

    /// Middle of the box.
    pub fn center(&self) -> Vector3<f32> {
        (self.min + self.max) * 0.5
    }

    /// Largest distance of a point of the box from `origin`, cm.
    pub fn max_distance_from(&self, origin: &Vector3<f32>) -> f32 {
        (self.min - origin).abs().sup(&(self.max - origin).abs()).norm()
    }
}

/// Largest grid accepted anywhere, so that node indices fit `u32`.
const MAX_NODES: usize = 1 << 30;

/// Tells fields apart: values never change once baked, so what was sampled of a field stays true of it and its clones,
/// and of no other field made while the program runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FieldId(u64);

impl FieldId {
    fn next() -> Self {
        static MADE: AtomicU64 = AtomicU64::new(0);
        Self(MADE.fetch_add(1, Ordering::Relaxed))
    }
}

/// Signed distance to a solid's surface on a uniform grid, in the solid's frame.
#[derive(Debug, Clone)]
pub struct SignedDistanceField {
    id: FieldId,
    origin: Vector3<f32>,
    cell: f32,
    inv_cell: f32,
    /// Nodes along x, y, z; at least 2 each.
    nodes: [usize; 3],
    /// Largest grid coordinate along each axis, `nodes - 1`.
    last: Vector3<f32>,
    layout: Layout,
    max_error: f32,
    band: f32,
    far_error: f32,
    /// Most that samples outside the surface change over a centimetre.
    steepest: f32,
}

/// Share of a length by which single-precision sampling may err: sixteen roundings.
const ROUND_OFF: f32 = 16.0 * f32::EPSILON;

/// How far the values of a grid can be trusted.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Trust {
    /// Largest overstatement of the distance within `band` of the surface, cm.
    pub max_error: f32,
    /// Distance from the surface up to which every cell has exact nodes, cm.
    pub band: f32,
    /// Largest overstatement of the distance anywhere, cm.
    pub far_error: f32,
}

/// The cell that a point lies in: where its corners begin, the fractions across it, and what its values stand for.
pub(super) struct Place {
    pub first: usize,
    pub t: Vector3<f32>,
    /// Centimetres, and slope, that a difference of one along an edge stands for.
    pub quantum: f32,
    pub slope: f32,
}

impl SignedDistanceField {
    /// Wraps bricks that cover `nodes` nodes from `origin` on.
    pub(crate) fn from_layout(
        origin: Vector3<f32>,
        cell: f32,
        nodes: [usize; 3],
        layout: Layout,
        trust: Trust,
    ) -> Self {
        // Outside the grid the bound grows by one at most.
        let steepest = (layout.steepest(nodes) / cell).max(1.0) * (1.0 + ROUND_OFF);
        Self {
            id: FieldId::next(),
            steepest,
            origin,
            cell,
            inv_cell: 1.0 / cell,
            nodes,
            last: Vector3::from(nodes.map(|n| (n - 1) as f32)),
            layout,
            max_error: trust.max_error,
            band: trust.band,
            far_error: trust.far_error,
        }
    }

    /// The same field, trusted otherwise.
    pub(crate) fn trusted(self, trust: Trust) -> Self {
        let Trust { max_error, band, far_error } = trust;
        Self { max_error, band, far_error, ..self }
    }

    pub(super) fn layout(&self) -> &Layout {
        &self.layout
    }

    pub(super) fn origin(&self) -> Vector3<f32> {
        self.origin
    }

    pub(super) fn inv_cell(&self) -> f32 {
        self.inv_cell
    }

    /// Nodes of a grid of this cell over `bounds`.
    ///
    /// # Errors
    /// [`Error::BadParameter`] for a cell or box that is not positive and finite, [`Error::TooLarge`] past `max_bytes`.
    pub(crate) fn plan(bounds: &Bounds, cell: f32, max_bytes: usize) -> Result<[usize; 3], Error> {
        if !(cell.is_finite() && cell > 0.0) {
            return Err(Error::BadParameter { name: "cell", value: cell, above: 0.0 });
        }
        let size = bounds.size();
        for (name, value) in [("bounds along x", size.x), ("bounds along y", size.y), ("bounds along z", size.z)] {
            if !(value.is_finite() && value > 0.0) {
                return Err(Error::BadParameter { name, value, above: 0.0 });
            }
        }
        let nodes: [usize; 3] =
            [size.x, size.y, size.z].map(|s| (f64::from(s) / f64::from(cell)).ceil().min(1e9) as usize + 1);
        let nodes = nodes.map(|n| n.max(2));
        let total = nodes.iter().try_fold(1usize, |a, &n| a.checked_mul(n)).unwrap_or(usize::MAX);
        let bytes = total.saturating_mul(size_of::<f32>());
        if total > MAX_NODES || bytes > max_bytes {
            return Err(Error::TooLarge { nodes, bytes, max_bytes });
        }
        Ok(nodes)
    }

    /// Edge of a grid cell, cm.
    pub fn cell(&self) -> f32 {
        self.cell
    }

    /// What tells this field from every other but its clones.
    pub fn id(&self) -> FieldId {
        self.id
    }

    /// Most that samples change over a centimetre of a straight path outside the surface, never too small: one and a
    /// little, since the slopes of a trilinear cell along its axes need not belong to one direction.
    pub fn steepest(&self) -> f32 {
        self.steepest
    }

    /// How far below its exact value [`Self::lower_bound`] may be computed where it is `bound`, cm: by rounding alone.
    #[inline]
    pub fn round_off(&self, bound: f32) -> f32 {
        ROUND_OFF * (bound.abs() + self.last.norm() * self.cell + self.origin.norm())
    }

    /// Nodes along x, y and z, as fine as near the surface everywhere.
    pub fn nodes(&self) -> [usize; 3] {
        self.nodes
    }

    /// The box the grid covers, in the solid's frame; the solid lies inside it.
    pub fn bounds(&self) -> Bounds {
        Bounds::new(self.origin, self.origin + self.last * self.cell)
    }

    /// Bytes held by values and table.
    pub fn memory_bytes(&self) -> usize {
        self.layout.bytes()
    }

    /// Largest amount, cm, by which a sample within [`Self::band`] of the surface overstates the distance. Measured
    /// at cell centres when baked, where trilinear interpolation errs most, with a quarter added.
    pub fn max_error(&self) -> f32 {
        self.max_error
    }

    /// Distance from the surface, cm, within which [`Self::max_error`] holds.
    pub fn band(&self) -> f32 {
        self.band
    }

    /// Largest amount, cm, by which a sample anywhere outside overstates the distance.
    pub fn far_error(&self) -> f32 {
        self.far_error
    }

    /// Signed distance at `p` (solid's frame), cm. Outside the grid a lower bound; not a number only for such a `p`.
    #[inline(always)]
    pub fn distance(&self, p: Vector3<f32>) -> f32 {
        let g = (p - self.origin) * self.inv_cell;
        if self.holds(&g) { self.interpolate(&g) } else { self.distance_outside(&g) }
    }

    /// Signed distance and its gradient at `p` (solid's frame). Inside the grid the gradient is exactly that of the
    /// trilinear interpolant, hence not of unit length.
    #[inline]
    pub fn distance_gradient(&self, p: Vector3<f32>) -> (f32, Vector3<f32>) {
        let g = (p - self.origin) * self.inv_cell;
        if self.holds(&g) { self.interpolate_gradient(&g) } else { self.gradient_outside(&g) }
    }

    /// A number the true distance at `p` is never below, for `p` outside or within a cell beneath the surface: the sample
    /// less the error that holds at that distance.
    #[inline]
    pub fn lower_bound(&self, p: Vector3<f32>) -> f32 {
        let d = self.distance(p);
        self.surely(d)
    }

    /// What a sampled distance `d` surely guarantees, cm. See [`Self::lower_bound`].
    #[inline]
    pub fn surely(&self, d: f32) -> f32 {
        if d > self.band { (d - self.far_error).max(self.band - self.max_error) } else { d - self.max_error }
    }

    /// Unit normal pointing out of the solid at `p`, and the distance there. Where the gradient vanishes (the middle of
    /// a solid, a ridge between two) the direction is looked for a cell away, and is at worst that from the box centre.
    pub fn outward_normal(&self, p: Vector3<f32>) -> (f32, Vector3<f32>) {
        let (d, gradient) = self.distance_gradient(p);
        (d, unit_or(gradient, || self.normal_nearby(p)))
    }

    #[cold]
    fn normal_nearby(&self, p: Vector3<f32>) -> Vector3<f32> {
        let h = self.cell;
        // A vanishing gradient means opposite slopes meet in one cell: any direction in which the distance grows is a
        // way out. The best of the 26 neighbours is taken, the first of equals.
        let mut best = (self.distance(p), Vector3::zeros());
        for k in 0..27 {
            let step = Vector3::new((k % 3) as f32 - 1.0, (k / 3 % 3) as f32 - 1.0, (k / 9) as f32 - 1.0) * h;
            let d = self.distance(p + step);
            if d > best.0 + 1e-6 * h {
                best = (d, step);
            }
        }
        unit_or(best.1, || unit_or(p - self.bounds().center(), Vector3::y))
    }

    /// Whether grid coordinates lie in the grid; false when not a number.
    #[inline(always)]
    fn holds(&self, g: &Vector3<f32>) -> bool {
        // Bitwise and: six comparisons without six branches.
        (g.x >= 0.0) & (g.y >= 0.0) & (g.z >= 0.0) & (g.x <= self.last.x) & (g.y <= self.last.y) & (g.z <= self.last.z)
    }

    #[inline(always)]
    pub(super) fn place(&self, g: &Vector3<f32>) -> Place {
        let [nx, ny, nz] = self.nodes;
        // Through 32 bits: the conversion to 64 takes several instructions more.
        let i = (g.x as i32 as usize).min(nx - 2);
        let j = (g.y as i32 as usize).min(ny - 2);
        let k = (g.z as i32 as usize).min(nz - 2);
        let entry = self.layout.entry(i / BRICK, j / BRICK, k / BRICK);
        let base = (entry & !COARSE) as usize;
        // Both ways in the same steps, so that no jump is mispredicted along a path through near and far.
        let coarse = entry & COARSE != 0;
        let within = first_corner(i as u32, j as u32, k as u32) as usize;
        let first = base + if coarse { 0 } else { within };
        let whole = if coarse { BRICK - 1 } else { 0 };
        let per_edge = if coarse { 1.0 / BRICK as f32 } else { 1.0 };
        let start = Vector3::new((i & !whole) as f32, (j & !whole) as f32, (k & !whole) as f32);
        let [quantum, slope] = self.scales(coarse);
        Place { first, t: (g - start) * per_edge, quantum, slope }
    }

    /// Centimetres, and slope, that one stands for in the values of a fine or a coarse cell.
    #[inline(always)]
    pub(super) fn scales(&self, coarse: bool) -> [f32; 2] {
        let (quantum, edges) =
            if coarse { (self.layout.coarse_quantum, 1.0 / BRICK as f32) } else { (self.layout.quantum, 1.0) };
        [quantum, quantum * (self.inv_cell * edges)]
    }

    /// The eight corner values of a cell in quanta: pairs along x, at (y, z) = (0,0), (1,0), (0,1), (1,1).
    #[inline(always)]
    fn corners(&self, first: usize) -> [[f32; 2]; 4] {
        let [a, b, c, d] = self.layout.corners(first);
        let single = |pair: [i16; 2]| [f32::from(pair[0]), f32::from(pair[1])];
        [single(a), single(b), single(c), single(d)]
    }

    #[inline(always)]
    pub(super) fn interpolate(&self, g: &Vector3<f32>) -> f32 {
        let Place { first, t, quantum, .. } = self.place(g);
        let x = self.corners(first).map(|[a, b]| a + t.x * (b - a));
        let y0 = x[0] + t.y * (x[1] - x[0]);
        let y1 = x[2] + t.y * (x[3] - x[2]);
        (y0 + t.z * (y1 - y0)) * quantum
    }

    #[inline(always)]
    fn interpolate_gradient(&self, g: &Vector3<f32>) -> (f32, Vector3<f32>) {
        let Place { first, t, quantum, slope } = self.place(g);
        let c = self.corners(first);
        let dx = c.map(|[a, b]| b - a);
        let x = [0, 1, 2, 3].map(|n: usize| c[n][0] + t.x * dx[n]);
        let (dy0, dy1) = (x[1] - x[0], x[3] - x[2]);
        let y0 = x[0] + t.y * dy0;
        let y1 = x[2] + t.y * dy1;
        let dx0 = dx[0] + t.y * (dx[1] - dx[0]);
        let dx1 = dx[2] + t.y * (dx[3] - dx[2]);
        let gradient = Vector3::new(dx0 + t.z * (dx1 - dx0), dy0 + t.z * (dy1 - dy0), y1 - y0);
        ((y0 + t.z * (y1 - y0)) * quantum, gradient * slope)
    }

    /// Signed distance at `p` and, squared (cm²), a bound that the distance to the solid is never below where the cell's
    /// nodes are exact; the bound is negative where it proves nothing, and not asked for beyond `far` (cm).
    ///
    /// The squared distance to any set less the square of the place is the least of functions linear in the place, hence
    /// concave: at a mean of nodes it is at least the mean of its values there. So is a lower bound what values rounded down
    /// make of it.
    #[inline]
    pub(crate) fn distance_and_bound2(&self, p: Vector3<f32>, far: f32) -> (f32, f32) {
        let g = (p - self.origin) * self.inv_cell;
        if !self.holds(&g) {
            return (self.distance_outside(&g), -1.0);
        }
        let Place { first, t, quantum, slope: _ } = self.place(&g);
        let c = self.corners(first);
        let mean = |of: [[f32; 2]; 4]| {
            let x = of.map(|[a, b]| a + t.x * (b - a));
            let y0 = x[0] + t.y * (x[1] - x[0]);
            let y1 = x[2] + t.y * (x[3] - x[2]);
            y0 + t.z * (y1 - y0)
        };
        let d = mean(c) * quantum;
        if quantum != self.layout.quantum || d > far {
            return (d, -1.0);
        }
        let square = mean(c.map(|pair| pair.map(|v| if v > 0.0 { v * v } else { 0.0 }))) * (quantum * quantum);
        // The mean of the nodes' squared distances from `p`.
        let spread = t.x * (1.0 - t.x) + t.y * (1.0 - t.y) + t.z * (1.0 - t.z);
        (d, square - spread * (self.cell * self.cell))
    }

    /// The nearest point of the grid's box, in grid coordinates.
    fn nearest(&self, g: &Vector3<f32>) -> Vector3<f32> {
        g.zip_map(&self.last, |x, last| x.clamp(0.0, last))
    }

    #[inline(never)]
    fn distance_outside(&self, g: &Vector3<f32>) -> f32 {
        let q = self.nearest(g);
        let gap = (g - q).norm() * self.cell;
        let d = self.interpolate(&q).max(0.0);
        (gap * gap + d * d).sqrt()
    }

    #[inline(never)]
    fn gradient_outside(&self, g: &Vector3<f32>) -> (f32, Vector3<f32>) {
        let q = self.nearest(g);
        let gap = (g - q) * self.cell;
        let (d, gradient) = self.interpolate_gradient(&q);
        let d = d.max(0.0);
        let total = (gap.norm_squared() + d * d).sqrt();
        // Along an axis on which the point is outside, q does not move with p: only the gap does.
        let along_face = gradient.zip_zip_map(g, &q, |slope, a, b| if a == b { slope } else { 0.0 });
        if total > 0.0 { (total, (gap + along_face * d) / total) } else { (total, gradient) }
    }
}

/// `v` at unit length, or what `otherwise` returns when it is too short to have a direction.
#[inline]
pub(crate) fn unit_or(v: Vector3<f32>, otherwise: impl FnOnce() -> Vector3<f32>) -> Vector3<f32> {
    /// Interpolated gradients of a distance are of order 1; below this only round-off is left.
    const SHORTEST: f32 = 1e-4;
    let n = v.norm();
    if n > SHORTEST { v / n } else { otherwise() }
}
