//! All guide sets of one strand with their weights: AS16 Algorithm 2.
//!
//! Every non-empty subset of the eligible guides is solved (Eq. 7) and fitted (Eq. 8); a set is discarded when one of its
//! guides never reaches the least weight, for then a smaller set does the same. What counts, here and for the stated
//! errors, are the weights as a runtime will use them: fitted, rounded to half precision, clamped, normalised. Single
//! guides are always kept. The order of the paper, by ascending size, changes nothing; sets are listed by mask.

use io_formats::skinning_model::MAX_ELIGIBLE;
use multiversion::multiversion;
use serde::{Deserialize, Serialize};

use crate::gram::{StrandGram, pair_index};
use crate::poly_fit::{PolyFit, Quadratic};
use crate::stand_ins::stand_ins;
use crate::subset_lanes::{LANES, Lane, SubsetLanes};
use crate::subset_weights::ridge_of_trace;

/// Particles that every guide alone puts this near (cm, RMS) do not tell guides apart.
const QUIET_CM: f64 = 1e-3;

/// The kept sets of one strand, as the model file wants them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StrandSets {
    /// Kept sets, ascending; bit b stands for the strand's b-th eligible guide.
    pub masks: Vec<u16>,
    /// Root mean square training error of each kept set (cm), over particles and frames.
    pub rms_error_cm: Vec<f32>,
    /// Per kept set and guide in bit order, half-precision bits of quad, lin, con.
    pub coeffs: Vec<[u16; 3]>,
    /// For mask m, at entry m - 1: index of the kept set standing in.
    pub stand_in: Vec<u16>,
    /// How well all eligible guides together explain the strand.
    pub full: FullSetError,
    /// Largest change of a weight of a kept set by rounding its coefficients to half precision.
    pub largest_rounding: f64,
}

/// Errors of the set of all eligible guides; squares, to be averaged over strands before the root is taken.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct FullSetError {
    /// Mean squared position error (cm²) with free weights at each particle: the least possible.
    pub free_squared_cm: f64,
    /// The same with quadratic weights, as stored.
    pub quadratic_squared_cm: f64,
    /// The same with weights linear along the strand.
    pub linear_squared_cm: f64,
    /// The same with weights cubic along the strand.
    pub cubic_squared_cm: f64,
    /// Mean squared free weight; zero for a strand of one guide, whose weight is one by definition.
    pub free_weight_squared: f64,
    /// Mean squared difference of the quadratics, as used, to the free weights.
    pub quadratic_weight_squared: f64,
    /// Mean squared difference of the straight lines, as used, to the free weights.
    pub linear_weight_squared: f64,
    /// Mean squared difference of the cubics, as used, to the free weights.
    pub cubic_weight_squared: f64,
}

/// One thread's memory for [`strand_sets`].
#[derive(Debug, Clone, Default)]
pub struct SubsetsWorkspace {
    lanes: SubsetLanes,
    /// By particle, the problem whose weights it takes.
    problem: Vec<usize>,
    /// By group of problems, what a unit of weight there adds to quad, lin, con.
    shares: Vec<[Lane; 3]>,
    /// `k * n_particles` free weights of the full set, guide-major.
    free: Vec<f64>,
    /// `set size * n_particles` weights of the set at hand, guide-major: as stored, and before rounding.
    used: Vec<f64>,
    exact: Vec<f64>,
    sums: Vec<f64>,
    products: Vec<f64>,
}

/// Solves, fits and sifts all subsets of one strand's eligible guides.
/// Implements AS16 Algorithm 2. `min_weight` is ε; `n_frames` is how many frames the matrices were summed over.
///
/// # Panics
/// If the matrices are of another particle count than the fit, or of more than nine guides.
#[must_use]
pub fn strand_sets(
    gram: &StrandGram,
    n_frames: usize,
    fit: &PolyFit,
    min_weight: f64,
    ws: &mut SubsetsWorkspace,
) -> StrandSets {
    let (k, n) = (gram.n_guides, gram.n_particles);
    assert_eq!(n, fit.n_particles(), "one fit per particle count");
    let n_masks = 1_usize << k;
    solve_all(gram, n_frames, fit, ws);

    let per_point = 1.0 / (n * n_frames.max(1)) as f64;
    let mut sets = StrandSets::default();
    for mask in 1..n_masks {
        let mut stored = [Quadratic::default(); MAX_ELIGIBLE];
        let mut bits = [[0; 3]; MAX_ELIGIBLE];
        let mut exact = [Quadratic::default(); MAX_ELIGIBLE];
        let size = mask.count_ones() as usize;
        fit_lanes(&ws.lanes, k, mask, &ws.shares, &mut exact);
        for at in 0..size {
            bits[at] = exact[at].to_bits();
            stored[at] = Quadratic::from_bits(bits[at]);
        }
        evaluate(&stored[..size], fit, &mut ws.used, &mut ws.sums);
        if size > 1 && ws.used.chunks_exact(n).any(|weights| weights.iter().all(|&w| w < min_weight)) {
            continue;
        }
        let squared = per_point * squared_error(gram, mask, &ws.used, &mut ws.sums, &mut ws.products);
        sets.masks.push(mask as u16);
        sets.rms_error_cm.push(squared.sqrt() as f32);
        sets.coeffs.extend_from_slice(&bits[..size]);
        evaluate(&exact[..size], fit, &mut ws.exact, &mut ws.sums);
        sets.largest_rounding = sets.largest_rounding.max(largest_difference(&ws.exact, &ws.used));
    }
    sets.stand_in = stand_ins(k, &sets.masks, &sets.rms_error_cm);
    sets.full = full_set_error(gram, per_point, fit, ws);
    sets
}

/// Solves all subsets at all particles, and keeps the free weights of the full set.
/// A particle that says nothing, as the fixed root, takes the weights of its neighbour towards the tip: even weights there
/// would lift every guide above the least weight at the root, and no set would ever be discarded.
fn solve_all(gram: &StrandGram, n_frames: usize, fit: &PolyFit, ws: &mut SubsetsWorkspace) {
    let (k, n) = (gram.n_guides, gram.n_particles);
    let quiet = (k * n_frames) as f64 * QUIET_CM * QUIET_CM;
    let trace = |i: usize| -> f64 { (0..k).map(|g| gram.values[pair_index(k, g, g) * n + i]).sum() };
    // Problems are numbered from the root; each quiet particle shares that of the first after it that is not.
    ws.problem.clear();
    ws.problem.resize(n, 0);
    let mut n_problems = 0;
    for i in 0..n {
        ws.problem[i] = n_problems;
        if trace(i) > quiet || i + 1 == n {
            n_problems += 1;
        }
    }
    ws.lanes.reset(k, n_problems);
    ws.shares.clear();
    ws.shares.resize(n_problems.div_ceil(LANES), [Lane([0.0; LANES]); 3]);
    for i in 0..n {
        let problem = ws.problem[i];
        for d in 0..3 {
            ws.shares[problem / LANES][d].0[problem % LANES] += fit.quadratic[i][d];
        }
        // The last particle of a problem is the one that has something to say.
        if ws.problem.get(i + 1) != Some(&problem) {
            ws.lanes.set_ridge(problem, ridge_of_trace(trace(i), k, n_frames));
            for (pair, values) in gram.values.chunks_exact(n).enumerate() {
                ws.lanes.set_pair(problem, pair, values[i]);
            }
        }
    }
    ws.lanes.solve();
    ws.free.clear();
    let full = (1 << k) - 1;
    for g in 0..k {
        ws.free.extend(ws.problem.iter().map(|&problem| ws.lanes.weight(full, g, problem)));
    }
}

/// The quadratics of one mask's weights, in bit order: AS16 Eq. (8), each lane summed by itself before they are joined.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn fit_lanes(lanes: &SubsetLanes, k: usize, mask: usize, shares: &[[Lane; 3]], out: &mut [Quadratic; MAX_ELIGIBLE]) {
    let in_set = (0..k).filter(|g| mask >> g & 1 == 1);
    for (out, g) in out.iter_mut().zip(in_set) {
        let mut sums = [[0.0; LANES]; 3];
        for (weights, shares) in lanes.weights(mask, g).iter().zip(shares) {
            for d in 0..3 {
                for lane in 0..LANES {
                    sums[d][lane] += shares[d].0[lane] * weights.0[lane];
                }
            }
        }
        let [quad, lin, con] = sums.map(|s| ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7])));
        *out = Quadratic { quad, lin, con };
    }
}

/// The weights of a set as used, guide-major: [`weights_at`](crate::poly_fit::weights_at) for all particles at once.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn evaluate(set: &[Quadratic], fit: &PolyFit, out: &mut Vec<f64>, totals: &mut Vec<f64>) {
    let n = fit.u.len();
    out.resize(set.len() * n, 0.0);
    totals.clear();
    totals.resize(n, 0.0);
    for (out, q) in out.chunks_exact_mut(n).zip(set) {
        for ((w, total), u) in out.iter_mut().zip(totals.iter_mut()).zip(&fit.u) {
            *w = q.at(*u).max(0.0);
            *total += *w;
        }
    }
    for out in out.chunks_exact_mut(n) {
        for (w, total) in out.iter_mut().zip(totals.iter()) {
            *w /= total;
        }
    }
}

fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).fold(0.0, |largest, (a, b)| largest.max((a - b).abs()))
}

/// Sum over particles of wᵀ H w (cm²), for weights of the guides in `mask`, guide-major.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn squared_error(gram: &StrandGram, mask: usize, weights: &[f64], sums: &mut Vec<f64>, products: &mut Vec<f64>) -> f64 {
    let (k, n) = (gram.n_guides, gram.n_particles);
    sums.clear();
    sums.resize(n, 0.0);
    products.resize(n, 0.0);
    let in_set = |g: &usize| mask >> g & 1 == 1;
    for (row, a) in (0..k).filter(in_set).enumerate() {
        products.fill(0.0);
        for (column, b) in (row..).zip((a..k).filter(in_set)) {
            let at = pair_index(k, a, b) * n;
            // Off the diagonal each pair stands for two entries.
            let times = if a == b { 1.0 } else { 2.0 };
            let (h, w) = (&gram.values[at..at + n], &weights[column * n..(column + 1) * n]);
            for ((p, h), w) in products.iter_mut().zip(h).zip(w) {
                *p += times * h * w;
            }
        }
        for ((sum, p), w) in sums.iter_mut().zip(products.iter()).zip(&weights[row * n..(row + 1) * n]) {
            *sum += p * w;
        }
    }
    // Round-off may leave a set without error slightly below zero.
    sums.iter().sum::<f64>().max(0.0)
}

fn full_set_error(gram: &StrandGram, per_point: f64, fit: &PolyFit, ws: &mut SubsetsWorkspace) -> FullSetError {
    let (k, n) = (gram.n_guides, gram.n_particles);
    let full = (1_usize << k) - 1;
    let free = std::mem::take(&mut ws.free);
    let mut error = FullSetError {
        free_squared_cm: per_point * squared_error(gram, full, &free, &mut ws.sums, &mut ws.products),
        ..FullSetError::default()
    };
    if k > 1 {
        error.free_weight_squared = free.iter().map(|w| w * w).sum::<f64>() / (k * n) as f64;
    }
    let SubsetsWorkspace { used, sums, products, .. } = ws;
    let mut against_free = |used: &[f64], sums: &mut Vec<f64>| {
        let weight = used.iter().zip(&free).map(|(a, b)| (a - b) * (a - b)).sum::<f64>() / (k * n) as f64;
        (per_point * squared_error(gram, full, used, sums, products), weight)
    };
    let of_guides = || free.chunks_exact(n);
    let stored: Vec<_> = of_guides().map(|weights| Quadratic::from_bits(fit.fit(weights).to_bits())).collect();
    evaluate(&stored, fit, used, sums);
    (error.quadratic_squared_cm, error.quadratic_weight_squared) = against_free(used, sums);
    let lines: Vec<_> = of_guides().map(|weights| fit.fit_line(weights)).collect();
    evaluate(&lines, fit, used, sums);
    (error.linear_squared_cm, error.linear_weight_squared) = against_free(used, sums);
    let cubics: Vec<_> = of_guides().map(|weights| fit.fit_cubic(weights)).collect();
    for (i, &u) in fit.u.iter().enumerate() {
        let total: f64 = cubics.iter().map(|q| q.at(u).max(0.0)).sum();
        cubics.iter().enumerate().for_each(|(g, q)| used[g * n + i] = q.at(u).max(0.0) / total);
    }
    (error.cubic_squared_cm, error.cubic_weight_squared) = against_free(used, sums);
    ws.free = free;
    error
}

#[cfg(test)]
mod tests {
    use io_formats::guide_transform::{Blend, DisplacementTransform, guide_transforms};
    use io_formats::{FrameInfo, MemoryFrames, UniformGroom, WeightPoly};
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::eligible::Eligible;
    use crate::gram::accumulate;

    const N: usize = 12;
    const N_FRAMES: usize = 40;
    /// Half precision of coefficients up to 2, three of them per weight.
    const HALF_PRECISION: f32 = 3e-3;
    /// Round-off of recorded `f32` positions within 20 cm.
    const ROUND_OFF_CM: f64 = 1e-5;

    /// Guides that wave at random; returns their rest shape and frames.
    fn waving_guides(k: usize, rng: &mut Pcg64Mcg) -> (Vec<[f32; 3]>, Vec<Vec<[f32; 3]>>) {
        let rest: Vec<[f32; 3]> =
            (0..k * N).map(|at| [(at / N) as f32 * 0.8, -((at % N) as f32), 0.1 * (at % N) as f32]).collect();
        let frames = (0..N_FRAMES)
            .map(|_| {
                let sway: Vec<[f32; 3]> = (0..k).map(|_| [0; 3].map(|_| rng.random_range(-0.03..0.03))).collect();
                let curl: Vec<f32> = (0..k).map(|_| rng.random_range(-0.5..0.5)).collect();
                (0..k * N)
                    .map(|at| {
                        let (g, i) = (at / N, (at % N) as f32);
                        let bent = (0.4 * i).sin() * curl[g];
                        [
                            rest[at][0] + sway[g][0] * i * i + bent,
                            rest[at][1] + sway[g][1] * i * i,
                            rest[at][2] + sway[g][2] * i * i + 0.5 * bent,
                        ]
                    })
                    .collect()
            })
            .collect();
        (rest, frames)
    }

    /// One strand more than the guides, blended from them with the `planted` weights.
    fn blended(planted: &[Quadratic], rng: &mut Pcg64Mcg) -> StrandGram {
        let k = planted.len();
        let (mut rest, guides) = waving_guides(k, rng);
        let strand_rest: Vec<[f32; 3]> = (0..N).map(|i| [1.3, -0.9 * i as f32, 0.4 + 0.05 * i as f32]).collect();
        rest.extend(&strand_rest);
        let mut frames = MemoryFrames::new(k + 1, N);
        for (f, mut points) in guides.into_iter().enumerate() {
            let mut strand = vec![[0.0_f32; 3]; N];
            let mut t = [DisplacementTransform::default(); N];
            for (g, q) in planted.iter().enumerate() {
                guide_transforms(&rest[g * N..(g + 1) * N], &points[g * N..(g + 1) * N], Blend::Rigid, &mut t);
                for i in 0..N {
                    let p = t[i].apply(strand_rest[i]);
                    let w = q.at(i as f64 / (N - 1) as f64) as f32;
                    (0..3).for_each(|c| strand[i][c] += w * p[c]);
                }
            }
            points.extend(strand);
            let info = FrameInfo { sequence: 0, time_s: f as f64 * 0.02 };
            frames.push(info, &points).expect("the frame has the right number of points");
        }
        let rest = UniformGroom { n_strands: k + 1, n_particles: N, points: rest };
        let guide_strands: Vec<u32> = (0..k as u32).collect();
        let mut start: Vec<u32> = (0..=k as u32).collect();
        start.push(2 * k as u32);
        let eligible = Eligible { start, guides: (0..k as u16).chain(0..k as u16).collect() };
        let strands = [k as u32];
        accumulate(&frames, &rest, &guide_strands, &eligible, &strands, Blend::Rigid, &mut |_| {})
            .expect("the frames can be read")
            .remove(0)
    }

    fn sets_of(gram: &StrandGram, min_weight: f64) -> StrandSets {
        let fit = PolyFit::new(N).expect("three particles or more");
        strand_sets(gram, N_FRAMES, &fit, min_weight, &mut SubsetsWorkspace::default())
    }

    #[test]
    fn planted_quadratic_weights_are_given_back() {
        let planted = [
            Quadratic { quad: 0.3, lin: -0.5, con: 0.5 },
            Quadratic { quad: -0.4, lin: 0.6, con: 0.1 },
            Quadratic { quad: 0.1, lin: -0.1, con: 0.2 },
            Quadratic { quad: 0.0, lin: 0.0, con: 0.2 },
        ];
        let sets = sets_of(&blended(&planted, &mut Pcg64Mcg::seed_from_u64(21)), 0.01);
        let full = sets.masks.len() - 1;
        assert_eq!(sets.masks[full], 0b1111);
        for (bits, q) in sets.coeffs[sets.coeffs.len() - 4..].iter().zip(&planted) {
            for i in 0..N {
                let u = i as f32 / (N - 1) as f32;
                let (found, expected) = (WeightPoly::from_bits(*bits).at(u), q.at(f64::from(u)) as f32);
                assert!((found - expected).abs() < HALF_PRECISION, "u = {u}: {found}, not {expected}");
            }
        }
        assert!(sets.full.free_squared_cm.sqrt() < ROUND_OFF_CM, "{:?}", sets.full);
        assert!(sets.full.linear_squared_cm > sets.full.quadratic_squared_cm);
        // Cubics are not rounded, and a quadratic is a cubic.
        assert!(sets.full.cubic_squared_cm.sqrt() < ROUND_OFF_CM && sets.full.cubic_weight_squared < 1e-10);
        assert!(sets.full.free_weight_squared > 1.0 / 16.0, "weights that sum to one over four guides");
        let best = sets.rms_error_cm.iter().copied().fold(f32::INFINITY, f32::min);
        assert_eq!(best, sets.rms_error_cm[full], "no other set explains the strand as well");
    }

    #[test]
    fn a_guide_without_weight_leaves_no_set_but_its_own() {
        let planted = [
            Quadratic { quad: 0.0, lin: -0.4, con: 0.7 },
            Quadratic::default(),
            Quadratic { quad: 0.0, lin: 0.4, con: 0.3 },
        ];
        let sets = sets_of(&blended(&planted, &mut Pcg64Mcg::seed_from_u64(4)), 0.01);
        assert!(sets.masks.contains(&0b101) && sets.masks.contains(&0b010), "{:?}", sets.masks);
        assert!(!sets.masks.contains(&0b111), "guide 1 adds nothing to guides 0 and 2");
        let index_of_pair = sets.masks.iter().position(|&m| m == 0b101).expect("checked above");
        assert_eq!(usize::from(sets.stand_in[0b111 - 1]), index_of_pair, "guides 0 and 2 stand in for all three");
    }

    #[test]
    fn a_root_that_never_moves_keeps_no_idle_guide() {
        let mut gram = StrandGram::zeros(2, N);
        // Guide 1 errs five times as far as guide 0, the same way, at all particles but the root.
        for (pair, h) in [1.0, 5.0, 25.0].into_iter().enumerate() {
            gram.values[pair * N + 1..(pair + 1) * N].fill(h);
        }
        let sets = sets_of(&gram, 0.01);
        assert_eq!(sets.masks, [0b01, 0b10]);
        assert_eq!(sets.stand_in, [0, 1, 0], "guide 0 stands in for both");
    }

    #[test]
    fn single_guides_are_kept_and_stored_weights_sum_to_one() {
        let mut rng = Pcg64Mcg::seed_from_u64(9);
        let noise: Vec<Quadratic> = (0..6).map(|_| Quadratic { con: 1.0 / 6.0, ..Quadratic::default() }).collect();
        let sets = sets_of(&blended(&noise, &mut rng), 0.01);
        for g in 0..6 {
            assert!(sets.masks.contains(&(1 << g)));
        }
        let mut at = 0;
        for mask in &sets.masks {
            let n = mask.count_ones() as usize;
            for u in [0.0, 0.3, 1.0] {
                let sum: f32 = sets.coeffs[at..at + n].iter().map(|&b| WeightPoly::from_bits(b).at(u)).sum();
                assert!((sum - 1.0).abs() < HALF_PRECISION * n as f32, "mask {mask:b}: {sum}");
            }
            at += n;
        }
        assert_eq!(at, sets.coeffs.len());
        assert!(sets.largest_rounding < f64::from(HALF_PRECISION), "{}", sets.largest_rounding);
        assert_eq!(sets.stand_in.len(), 63);
    }
}
