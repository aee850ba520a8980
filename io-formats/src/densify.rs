//! More strands from few, or fewer from many: what turns a groom of guides into a full head.
//!
//! A new strand grows between the roots of one strand and two of its neighbours. It follows the flow of all three, taken
//! from cubics fitted to them, and has the curls of the one it grows beside: averaged curls of different phase would cancel.
//! Where neighbours part it follows its own strand alone. Every strand of the groom gets equally many new ones, so density
//! stays as it was groomed. Invariant: strands are the groom's own first, and the same for the same seed.

use nalgebra::{DMatrix, Vector3};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::error::{Error, Result};
use crate::groom::{UniformGroom, arc_length};

/// Neighbours that a new strand may grow towards.
const NEIGHBOURS: usize = 6;

/// Neighbours whose flow differs by more than this share of a strand's length, root difference taken out, are on the other
/// side of a parting; those longer or shorter by more than this factor are of another cut.
const MOST_PARTING: f64 = 0.35;
const MOST_LENGTH_RATIO: f64 = 1.6;

/// Degree of the curves that flow is taken from.
const DEGREE: usize = 3;

/// A groom of `n_strands` made from another: the groom's own strands and new ones between them, or an even choice of its
/// own where there are more than asked for. Counts are at most `u32::MAX`.
///
/// # Errors
/// [`Error::EmptyGroom`] for a groom or a number of no strands.
pub fn densify(groom: &UniformGroom, n_strands: usize, seed: u64) -> Result<UniformGroom> {
    let (n_own, n) = (groom.n_strands, groom.n_particles);
    if n_own == 0 || n_strands == 0 {
        return Err(Error::EmptyGroom);
    }
    let mut points = Vec::with_capacity(n_strands * n);
    for k in 0..n_own.min(n_strands) {
        let own = if n_own > n_strands { k * n_own / n_strands } else { k };
        points.extend_from_slice(groom.strand(own));
    }
    if n_strands > n_own {
        let parents = Parents::new(groom);
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        for k in n_own..n_strands {
            parents.grow(k % n_own, &mut random, &mut points);
        }
    }
    Ok(UniformGroom { n_strands, n_particles: n, points })
}

/// Strands that others grow between.
struct Parents<'a> {
    groom: &'a UniformGroom,
    /// Fitted curves at the particles, cm.
    flow: Vec<Vector3<f64>>,
    length: Vec<f64>,
    /// Usable neighbours of each, nearest first.
    neighbours: Vec<Vec<usize>>,
}

fn vector(p: [f32; 3]) -> Vector3<f64> {
    Vector3::from(p).cast()
}

impl<'a> Parents<'a> {
    fn new(groom: &'a UniformGroom) -> Self {
        let n = groom.n_particles;
        // The projection on polynomials in the arc length; a strand of few particles is its own flow.
        let powers = DMatrix::from_fn(n, (DEGREE + 1).min(n), |i, d| (i as f64 / (n - 1).max(1) as f64).powi(d as i32));
        let q = powers.qr().q();
        let projection = &q * q.transpose();
        let mut flow = Vec::with_capacity(groom.points.len());
        for strand in groom.points.chunks_exact(n) {
            flow.extend(
                (0..n).map(|i| -> Vector3<f64> { (0..n).map(|j| vector(strand[j]) * projection[(i, j)]).sum() }),
            );
        }
        let length = (0..groom.n_strands).map(|s| arc_length(groom.strand(s))).collect();
        let mut parents = Self { groom, flow, length, neighbours: Vec::new() };
        let roots: Vec<Vector3<f64>> = (0..groom.n_strands).map(|s| vector(groom.strand(s)[0])).collect();
        parents.neighbours = nearest_roots(&roots)
            .into_iter()
            .enumerate()
            .map(|(s, near)| near.into_iter().filter(|&other| parents.flow_alike(s, other)).collect())
            .collect();
        parents
    }

    /// Whether two strands go the same way, seen from their roots, and are of about one length.
    fn flow_alike(&self, a: usize, b: usize) -> bool {
        let n = self.groom.n_particles;
        let apart = self.root(a) - self.root(b);
        let parting: f64 = (0..n).map(|i| (self.flow[a * n + i] - self.flow[b * n + i] - apart).norm()).sum();
        let ratio = self.length[a] / self.length[b];
        (1.0 / MOST_LENGTH_RATIO..=MOST_LENGTH_RATIO).contains(&ratio)
            && parting <= MOST_PARTING * n as f64 * self.length[a].min(self.length[b])
    }

    fn root(&self, strand: usize) -> Vector3<f64> {
        vector(self.groom.strand(strand)[0])
    }

    /// Adds a strand beside the given one.
    fn grow(&self, own: usize, random: &mut Pcg64Mcg, out: &mut Vec<[f32; 3]>) {
        let n = self.groom.n_particles;
        let near = &self.neighbours[own];
        let mut toward = [(own, 0.0); 2];
        if !near.is_empty() {
            let (mut u, mut v) = (random.random::<f64>(), random.random::<f64>());
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            // Of the three corners its own strand has the largest share: what lies nearer to others is theirs to grow.
            let own_share = 1.0 - u - v;
            let most = own_share.max(u).max(v);
            let [u, v] = if most == u {
                [own_share, v]
            } else if most == v {
                [u, own_share]
            } else {
                [u, v]
            };
            let one = random.random_range(0..near.len());
            let other = random.random_range(0..near.len());
            toward = [(near[one], u), (near[other], v)];
        }
        let blend = |of: &dyn Fn(usize) -> Vector3<f64>| -> Vector3<f64> {
            toward.iter().map(|&(strand, share)| (of(strand) - of(own)) * share).sum()
        };
        let root = blend(&|s| self.root(s));
        // The fit misses the root by a little; what is added there fades out along the strand.
        let missed = root - blend(&|s| self.flow[s * n]);
        let strand = self.groom.strand(own);
        let grown: Vec<Vector3<f64>> = (0..n)
            .map(|i| {
                let to_tip = 1.0 - i as f64 / (n - 1).max(1) as f64;
                vector(strand[i]) + blend(&|s| self.flow[s * n + i]) + missed * (to_tip * to_tip)
            })
            .collect();
        let length: f64 = grown.windows(2).map(|w| (w[1] - w[0]).norm()).sum();
        let wanted: f64 = self.length[own]
            + toward.iter().map(|&(strand, share)| share * (self.length[strand] - self.length[own])).sum::<f64>();
        let scale = if length > 0.0 { wanted / length } else { 1.0 };
        out.extend(grown.iter().map(|p| -> [f32; 3] { (grown[0] + (p - grown[0]) * scale).cast::<f32>().into() }));
    }
}

/// The nearest roots of each root, nearest first; roots in one place are no neighbours.
fn nearest_roots(roots: &[Vector3<f64>]) -> Vec<Vec<usize>> {
    let of_one = |from: &Vector3<f64>| {
        let mut best: Vec<(f64, usize)> = Vec::with_capacity(NEIGHBOURS + 1);
        for (k, root) in roots.iter().enumerate() {
            let distance2 = (root - from).norm_squared();
            let is_better = best.len() < NEIGHBOURS || distance2 < best[NEIGHBOURS - 1].0;
            if distance2 > 0.0 && is_better {
                let place = best.partition_point(|b| b.0 <= distance2);
                best.insert(place, (distance2, k));
                best.truncate(NEIGHBOURS);
            }
        }
        best.into_iter().map(|(_, k)| k).collect()
    };
    roots.iter().map(of_one).collect()
}
