//! Which triangle is nearest a point: a tree of boxes over the triangles of a scalp, halved at the median of their middles.
//!
//! What is found is what going through all triangles in order finds, to the bit: distances are computed by the caller alone,
//! boxes only rule out, with a margin for round-off, and of triangles equally near the first counts.

use nalgebra::Vector3;

/// Triangles that a leaf holds at most.
const LEAF: usize = 4;

/// What a box's squared distance may be too large by, as a share of the coordinates' squares: a few roundings of each.
const ROUND_OFF: f64 = 1e-14;

/// A box around triangles, and where they are.
#[derive(Debug)]
struct Node {
    low: Vector3<f64>,
    high: Vector3<f64>,
    /// Range of `order`.
    range: std::ops::Range<usize>,
    /// Second child; the first one follows its parent. Zero in a leaf.
    second: usize,
}

/// A tree of boxes.
#[derive(Debug)]
pub(super) struct Nearest {
    nodes: Vec<Node>,
    /// Triangles, those of a node side by side.
    order: Vec<usize>,
}

impl Nearest {
    /// A tree over triangles given by their corners, cm.
    pub fn new(triangles: &[[Vector3<f64>; 3]]) -> Self {
        let mut tree = Self { nodes: Vec::new(), order: (0..triangles.len()).collect() };
        if !triangles.is_empty() {
            tree.grow(triangles, 0..triangles.len());
        }
        tree
    }

    fn grow(&mut self, triangles: &[[Vector3<f64>; 3]], range: std::ops::Range<usize>) {
        let corners = || self.order[range.clone()].iter().flat_map(|&t| triangles[t]);
        let low = corners().fold(Vector3::repeat(f64::INFINITY), |a, b| a.inf(&b));
        let high = corners().fold(Vector3::repeat(f64::NEG_INFINITY), |a, b| a.sup(&b));
        let node = self.nodes.len();
        self.nodes.push(Node { low, high, range: range.clone(), second: 0 });
        if range.len() <= LEAF {
            return;
        }
        let axis = (high - low).imax();
        let middle = |t: usize| triangles[t].iter().map(|c| c[axis]).sum::<f64>();
        let half = range.len() / 2;
        self.order[range.clone()]
            .select_nth_unstable_by(half, |&a, &b| middle(a).total_cmp(&middle(b)).then_with(|| a.cmp(&b)));
        self.grow(triangles, range.start..range.start + half);
        self.nodes[node].second = self.nodes.len();
        self.grow(triangles, range.start + half..range.end);
    }

    /// The triangle of least squared distance to `point`, the first of equals; `distance2` gives that of each.
    pub fn find(&self, point: Vector3<f64>, mut distance2: impl FnMut(usize) -> f64) -> Option<usize> {
        let mut best: Option<(f64, usize)> = None;
        let mut open = Vec::with_capacity(64);
        open.extend((!self.nodes.is_empty()).then_some(0));
        while let Some(at) = open.pop() {
            let node = &self.nodes[at];
            let outside = (node.low - point).sup(&(point - node.high)).sup(&Vector3::zeros());
            let size2 = point.norm_squared() + node.low.norm_squared() + node.high.norm_squared();
            if best.is_some_and(|(least, _)| outside.norm_squared() - ROUND_OFF * size2 > least) {
                continue;
            }
            if node.second == 0 {
                for &t in &self.order[node.range.clone()] {
                    let found = (distance2(t), t);
                    let is_nearer = |best: (f64, usize)| found.0.total_cmp(&best.0).then(t.cmp(&best.1)).is_lt();
                    if best.is_none_or(is_nearer) {
                        best = Some(found);
                    }
                }
                continue;
            }
            // The child whose middle is nearer is looked into first.
            let far = |n: usize| (self.nodes[n].low + self.nodes[n].high - point * 2.0).norm_squared();
            let (first, second) = (at + 1, node.second);
            open.extend(if far(first) < far(second) { [second, first] } else { [first, second] });
        }
        best.map(|(_, t)| t)
    }
}
