//! The eligible guides of graph-based selection, after Chai et al. 2014: those of a strand's own part and of the parts around
//! it, sifted by one set of weights for the whole strand.
//!
//! For each strand Σ_f |Σ_g w_g d_g - d_s|² over all particles is minimised over w >= 0, Σw = 1, d being displacements from
//! rest: B translates. The guides of the largest weights stay, and are solved again for every subset and particle as all
//! eligible guides are (AS16 Eq. 7). A part's strands share their candidates, hence the Gram matrix of these; only products
//! of a strand with each are its own. Sums come in order of frames: same bytes for any number of threads.

use io_formats::{FrameSource, UniformGroom};
use rayon::prelude::*;

use super::graph::GuideParts;
use super::vectors::dot;
use crate::eligible::{Eligible, EligibleParams};
use crate::error::Result;

/// Candidates of a strand at most; of more adjacent parts the weakest connected are left out.
const MOST_CANDIDATES: usize = 16;
/// Optimality of weights, in shares of the largest diagonal entry.
const TOLERANCE: f64 = 1e-9;
/// Exchanges of weight between two guides at most.
const MOST_EXCHANGES: usize = 20_000;

/// Chooses the eligible guides of every strand. `rest` is s* (cm, head frame); of `params` β is not used. A guide is
/// eligible for itself alone.
///
/// # Errors
/// When a frame cannot be read.
///
/// # Panics
/// If `parts` are of other strands than the frames.
pub fn choose_eligible_of_parts(
    frames: &dyn FrameSource,
    rest: &UniformGroom,
    parts: &GuideParts,
    params: &EligibleParams,
    on_frame: &mut dyn FnMut(u64),
) -> Result<Eligible> {
    let candidates: Vec<Vec<u32>> = (0..parts.guide_strands.len())
        .map(|p| {
            let own = std::iter::once(p as u32);
            own.chain(parts.adjacent[p].iter().copied()).take(MOST_CANDIDATES).collect()
        })
        .collect();
    let products = displacement_products(frames, rest, parts, &candidates, on_frame)?;
    let chosen: Vec<Vec<u16>> = (0..parts.part.len())
        .into_par_iter()
        .map(|strand| {
            let part = parts.part[strand] as usize;
            if parts.guide_strands[part] as usize == strand {
                return vec![part as u16];
            }
            let weights = simplex_weights(&products.of_guides[part], &products.of_strands[strand]);
            strongest(&candidates[part], &weights, params)
        })
        .collect();
    let mut eligible = Eligible { start: vec![0], guides: Vec::new() };
    for of_strand in chosen {
        eligible.guides.extend(of_strand);
        eligible.start.push(eligible.guides.len() as u32);
    }
    Ok(eligible)
}

/// Guides by weight, the first candidates before others of the same, then ascending.
fn strongest(candidates: &[u32], weights: &[f64], params: &EligibleParams) -> Vec<u16> {
    let mut order: Vec<usize> = (0..candidates.len()).collect();
    order.sort_by(|&a, &b| weights[b].total_cmp(&weights[a]).then(a.cmp(&b)));
    let carrying = order.iter().filter(|&&g| weights[g] >= params.min_weight).count();
    order.truncate(carrying.max(params.min_guides).min(params.max_guides));
    let mut chosen: Vec<u16> = order.iter().map(|&g| candidates[g] as u16).collect();
    chosen.sort_unstable();
    chosen
}

/// Products of displacements, over all particles and frames (cm²).
struct Products {
    /// Per part, of each candidate with each, by rows.
    of_guides: Vec<Vec<f64>>,
    /// Per strand, with each candidate of its part.
    of_strands: Vec<Vec<f64>>,
}

fn displacement_products(
    frames: &dyn FrameSource,
    rest: &UniformGroom,
    parts: &GuideParts,
    candidates: &[Vec<u32>],
    on_frame: &mut dyn FnMut(u64),
) -> Result<Products> {
    let n = rest.n_particles;
    let mut frame = vec![[0.0_f32; 3]; rest.points.len()];
    let mut of_guides: Vec<Vec<f64>> = candidates.iter().map(|c| vec![0.0; c.len() * c.len()]).collect();
    let mut of_strands: Vec<Vec<f64>> = parts.part.iter().map(|&p| vec![0.0; candidates[p as usize].len()]).collect();
    for f in 0..frames.n_frames() {
        frames.read(f, &mut frame)?;
        let fill = |strand: usize, out: &mut Vec<f64>| {
            let points = frame[strand * n..(strand + 1) * n].iter().zip(rest.strand(strand));
            out.clear();
            out.extend(points.flat_map(|(now, before)| [0, 1, 2].map(|c| f64::from(now[c]) - f64::from(before[c]))));
        };
        let mut moved = vec![Vec::new(); parts.guide_strands.len()];
        moved.par_iter_mut().zip(&parts.guide_strands).for_each(|(out, &strand)| fill(strand as usize, out));
        of_guides.par_iter_mut().zip(candidates).for_each(|(sums, guides)| {
            for (a, row) in sums.chunks_exact_mut(guides.len()).enumerate() {
                let of_a = &moved[guides[a] as usize];
                row.iter_mut().zip(guides).for_each(|(sum, &b)| *sum += dot(of_a, &moved[b as usize]));
            }
        });
        of_strands.par_iter_mut().enumerate().for_each_init(Vec::new, |own, (strand, sums)| {
            fill(strand, own);
            let guides = &candidates[parts.part[strand] as usize];
            sums.iter_mut().zip(guides).for_each(|(sum, &g)| *sum += dot(own, &moved[g as usize]));
        });
        on_frame(f as u64 + 1);
    }
    Ok(Products { of_guides, of_strands })
}

/// Minimises wᵀ G w - 2 bᵀ w over w >= 0, Σw = 1: weight goes from the guide that would lose most by giving it up last to the
/// one that gains most, as far as is best for the two, until no exchange gains.
fn simplex_weights(gram: &[f64], right: &[f64]) -> Vec<f64> {
    let k = right.len();
    let at = |a: usize, b: usize| gram[a * k + b];
    let largest = (0..k).fold(f64::MIN_POSITIVE, |m, g| at(g, g).max(m));
    let mut w = vec![0.0; k];
    let alone = |g: &usize| at(*g, *g) - 2.0 * right[*g];
    let Some(best) = (0..k).min_by(|a, b| alone(a).total_cmp(&alone(b))) else { return w };
    w[best] = 1.0;
    let mut slope: Vec<f64> = (0..k).map(|g| at(g, best) - right[g]).collect();
    for _ in 0..MOST_EXCHANGES {
        let to = (0..k).min_by(|&a, &b| slope[a].total_cmp(&slope[b]));
        let from = (0..k).filter(|&g| w[g] > 0.0).max_by(|&a, &b| slope[a].total_cmp(&slope[b]));
        let (Some(to), Some(from)) = (to, from) else { break };
        let gain = slope[from] - slope[to];
        if gain <= TOLERANCE * largest {
            break;
        }
        let curvature = at(to, to) + at(from, from) - 2.0 * at(to, from);
        // Two guides that move alike bend nothing: all of the weight may go.
        let step = if curvature > 0.0 { (gain / curvature).min(w[from]) } else { w[from] };
        w[to] += step;
        // No remainder of round-off keeps a guide in.
        w[from] = if step >= w[from] { 0.0 } else { w[from] - step };
        slope.iter_mut().enumerate().for_each(|(g, s)| *s += step * (at(g, to) - at(g, from)));
    }
    w
}

#[cfg(test)]
mod tests {
    use io_formats::skinning_model::MAX_ELIGIBLE;
    use io_formats::{FrameInfo, MemoryFrames};
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::subset_weights::{Square, quadratic_form, solve_general};

    /// Of objectives of some hundred cm², solved to 1e-9 of the largest diagonal entry.
    const OPTIMAL: f64 = 1e-6;
    /// Of weights, found from `f32` positions.
    const NEAR: f64 = 1e-3;

    #[test]
    fn exchanges_end_where_the_general_solver_does() {
        let mut rng = Pcg64Mcg::seed_from_u64(21);
        for k in [1, 2, 5, MAX_ELIGIBLE] {
            for _ in 0..20 {
                let vectors: Vec<Vec<f64>> =
                    (0..=k).map(|_| (0..30).map(|_| rng.random_range(-1.0..3.0)).collect()).collect();
                let gram: Vec<f64> = (0..k * k).map(|at| dot(&vectors[at / k], &vectors[at % k])).collect();
                let right: Vec<f64> = (0..k).map(|g| dot(&vectors[g], &vectors[k])).collect();
                let found = simplex_weights(&gram, &right);
                assert!((found.iter().sum::<f64>() - 1.0).abs() < OPTIMAL && found.iter().all(|&w| w >= 0.0));
                // The same as residuals of weights that sum to one.
                let own = dot(&vectors[k], &vectors[k]);
                let mut h: Square = [[0.0; MAX_ELIGIBLE]; MAX_ELIGIBLE];
                for a in 0..k {
                    (0..k).for_each(|b| h[a][b] = gram[a * k + b] - right[a] - right[b] + own);
                }
                let general = solve_general(&h, k, 0.0).expect("a well-posed problem");
                let mut ours = [0.0; MAX_ELIGIBLE];
                ours[..k].copy_from_slice(&found);
                let (ours, general) = (quadratic_form(&h, k, &ours), quadratic_form(&h, k, &general));
                assert!((ours - general).abs() < OPTIMAL * general.max(1.0), "{k} guides: {ours}, {general}");
            }
        }
    }

    /// Guides 0 to 3 are strands 0 to 3, each moving its own way; strand 4 is blended of guides 0 and 2, strand 5 of 1 and 3.
    fn blended() -> (UniformGroom, MemoryFrames) {
        const N: usize = 4;
        let mut rng = Pcg64Mcg::seed_from_u64(3);
        let points: Vec<[f32; 3]> = (0..6 * N).map(|at| [(at / N) as f32, 0.0, -((at % N) as f32)]).collect();
        let rest = UniformGroom { n_strands: 6, n_particles: N, points };
        let mut frames = MemoryFrames::new(6, N);
        for f in 0..30 {
            let moved: Vec<[f32; 3]> = (0..4 * N).map(|_| [0; 3].map(|_| rng.random_range(-1.0..1.0))).collect();
            let of = |g: usize, i: usize, c: usize| moved[g * N + i][c];
            let mut now = rest.points.clone();
            for (at, p) in now.iter_mut().enumerate() {
                let (s, i) = (at / N, at % N);
                for c in 0..3 {
                    p[c] += match s {
                        4 => 0.7 * of(0, i, c) + 0.3 * of(2, i, c),
                        5 => 0.5 * of(1, i, c) + 0.5 * of(3, i, c),
                        _ => of(s, i, c),
                    };
                }
            }
            let info = FrameInfo { sequence: 0, time_s: f64::from(f) };
            frames.push(info, &now).expect("the frame has the right number of points");
        }
        (rest, frames)
    }

    #[test]
    fn guides_a_strand_was_blended_of_become_eligible_if_their_part_touches_its_own() {
        let (rest, frames) = blended();
        // Part 3 touches part 0 alone: of the two guides of strand 5 only its own part's is a candidate.
        let parts = GuideParts {
            guide_strands: vec![0, 1, 2, 3],
            part: vec![0, 1, 2, 3, 0, 3],
            adjacent: vec![vec![1, 2, 3], vec![0], vec![0], vec![0]],
        };
        let params = EligibleParams { sparsity: 0.0, min_weight: 0.01, min_guides: 1, max_guides: 9 };
        let eligible =
            choose_eligible_of_parts(&frames, &rest, &parts, &params, &mut |_| {}).expect("frames can be read");
        assert_eq!(eligible.of(4), [0, 2]);
        assert!(eligible.of(5).contains(&3) && !eligible.of(5).contains(&1));
        (0..4).for_each(|g| assert_eq!(eligible.of(g), [g as u16]));
        let products = displacement_products(
            &frames,
            &rest,
            &parts,
            &[vec![0, 1, 2, 3], vec![1, 0], vec![2, 0], vec![3, 0]],
            &mut |_| {},
        )
        .expect("frames can be read");
        let weights = simplex_weights(&products.of_guides[0], &products.of_strands[4]);
        for (w, planted) in weights.iter().zip([0.7, 0.0, 0.3, 0.0]) {
            assert!((w - planted).abs() < NEAR, "{weights:?}");
        }
    }
}
