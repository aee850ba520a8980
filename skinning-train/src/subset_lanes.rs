//! Weights of every subset for many particles at once: AS16 Eq. (7), the walk of [`crate::subset_weights`] in vector lanes.
//!
//! The particles of one strand have the same eligible guides, so their walks meet the masks in the same order and take the
//! same steps but for the sign of weights. Eight of them fill a lane array, and where one has a negative weight its best
//! child is picked by comparison instead of a branch. A lane computes what [`SubsetWeights`](crate::subset_weights::SubsetWeights)
//! computes for its problem alone, in the same order: the results have the same bits.

use io_formats::skinning_model::MAX_ELIGIBLE;
use multiversion::multiversion;

use crate::gram::pair_index;
use crate::subset_weights::Square;

/// Problems side by side.
pub const LANES: usize = 8;

/// One number for each of eight problems; aligned, or each would lie across two cache lines.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(64))]
pub struct Lane(pub [f64; LANES]);

const ZERO: Lane = Lane([0.0; LANES]);
const ONE: Lane = Lane([1.0; LANES]);

/// All bits for the problems chosen, none for the others.
type Chosen = [u64; LANES];

macro_rules! lanewise {
    ($(#[$doc:meta])* $name:ident($($x:ident),+) = $value:expr) => {
        $(#[$doc])*
        #[inline(always)]
        fn $name($($x: &Lane),+) -> Lane {
            let mut out = ZERO;
            for at in 0..LANES {
                $(let $x = $x.0[at];)+
                out.0[at] = $value;
            }
            out
        }
    };
}

/// Runs the body for each index below a bound known to the compiler, up to nine, without a loop: of a loop over guides it
/// would make vectors that run across guides, and gather and scatter what lies side by side within a lane array.
macro_rules! unrolled {
    ($at:ident < $bound:expr, $body:block) => {
        unrolled!(@ $at, $bound, $body, 0, 1, 2, 3, 4, 5, 6, 7, 8)
    };
    ($bound:expr, down to $at:ident, $body:block) => {
        unrolled!(@ $at, $bound, $body, 8, 7, 6, 5, 4, 3, 2, 1, 0)
    };
    (@ $at:ident, $bound:expr, $body:block, $($index:literal),+) => {
        $({
            let $at: usize = $index;
            if $at < $bound $body
        })+
    };
}

lanewise!(
    /// a + b
    add(a, b) = a + b
);
lanewise!(
    /// a b
    mul(a, b) = a * b
);
lanewise!(
    /// c - a b, rounded once.
    less_product(a, b, c) = (-a).mul_add(b, c)
);
lanewise!(
    /// 1 / a
    inverse(a) = 1.0 / a
);
lanewise!(
    /// The larger of both.
    larger(a, b) = if a > b { a } else { b }
);
lanewise!(
    /// The smaller of both.
    smaller(a, b) = if a < b { a } else { b }
);

/// Where x is negative and a below b.
#[inline(always)]
fn negative_and_less(x: &Lane, a: &Lane, b: &Lane) -> Chosen {
    let mut chosen = [0; LANES];
    for at in 0..LANES {
        chosen[at] = u64::from((x.0[at] < 0.0) & (a.0[at] < b.0[at])).wrapping_neg();
    }
    chosen
}

/// a where chosen, else b: by bits, which leaves the compiler no branch to make of it.
#[inline(always)]
fn pick(chosen: &Chosen, a: &Lane, b: &Lane) -> Lane {
    let mut out = ZERO;
    for at in 0..LANES {
        out.0[at] = f64::from_bits((a.0[at].to_bits() & chosen[at]) | (b.0[at].to_bits() & !chosen[at]));
    }
    out
}

#[inline(always)]
fn any_negative(x: &Lane) -> bool {
    x.0.iter().fold(0, |signs, x| signs | u64::from(*x < 0.0)) != 0
}

/// Problems of up to nine guides, all of the same number, and the weights of all their subsets.
#[derive(Debug, Clone, Default)]
pub struct SubsetLanes {
    n_guides: usize,
    n_problems: usize,
    /// Groups of eight problems.
    n_groups: usize,
    /// Per pair of guides (in the order of [`pair_index`]) and group.
    h: Vec<Lane>,
    /// Per group.
    ridge: Vec<Lane>,
    factors: Vec<Factor>,
    /// Per mask, guide and group; zero outside the mask.
    weights: Vec<Lane>,
    /// Per mask and group.
    objective: Vec<Lane>,
}

/// What H + ridge of the guides of one mask factors into, L D Lᵀ, one row per guide from the highest bit of the mask down.
#[derive(Debug, Clone)]
struct Factor {
    /// Below the unit diagonal.
    rows: [[Lane; MAX_ELIGIBLE]; MAX_ELIGIBLE],
    inverse_pivot: [Lane; MAX_ELIGIBLE],
    /// L⁻¹ 1, and that over the pivots.
    forward: [Lane; MAX_ELIGIBLE],
    scaled: [Lane; MAX_ELIGIBLE],
}

impl Factor {
    const ZERO: Self = Self {
        rows: [[ZERO; MAX_ELIGIBLE]; MAX_ELIGIBLE],
        inverse_pivot: [ZERO; MAX_ELIGIBLE],
        forward: [ZERO; MAX_ELIGIBLE],
        scaled: [ZERO; MAX_ELIGIBLE],
    };
}

impl SubsetLanes {
    /// Makes room for `n_problems` of `n_guides` each; problems that are not [`set`](Self::set) have no meaning.
    ///
    /// # Panics
    /// If there are not 1 to 9 guides.
    pub fn reset(&mut self, n_guides: usize, n_problems: usize) {
        assert!((1..=MAX_ELIGIBLE).contains(&n_guides), "{n_guides} eligible guides");
        let n_groups = n_problems.div_ceil(LANES);
        let refill = |lanes: &mut Vec<Lane>, per_group: usize, value: f64| {
            lanes.clear();
            lanes.resize(per_group * n_groups, Lane([value; LANES]));
        };
        refill(&mut self.h, n_guides * (n_guides + 1) / 2, 0.0);
        // Lanes left over solve zero matrices.
        refill(&mut self.ridge, 1, 1.0);
        // Every mask writes all its own weights; of the same shape, those outside are zero already.
        if (n_guides, n_groups) != (self.n_guides, self.n_groups) {
            let n_masks = 1 << n_guides;
            refill(&mut self.weights, n_masks * n_guides, 0.0);
            refill(&mut self.objective, n_masks, 0.0);
            self.factors.resize(n_groups, Factor::ZERO);
        }
        (self.n_guides, self.n_problems, self.n_groups) = (n_guides, n_problems, n_groups);
    }

    /// One problem: its matrix, and what is added to the diagonal, which must be positive.
    ///
    /// # Panics
    /// If there is no such problem.
    pub fn set(&mut self, problem: usize, h: &Square, ridge: f64) {
        for a in 0..self.n_guides {
            for b in a..self.n_guides {
                self.set_pair(problem, pair_index(self.n_guides, a, b), h[a][b]);
            }
        }
        self.set_ridge(problem, ridge);
    }

    /// The entry of one problem's matrix for a pair of guides, by [`pair_index`].
    ///
    /// # Panics
    /// If there is no such problem or pair.
    pub fn set_pair(&mut self, problem: usize, pair: usize, value: f64) {
        assert!(problem < self.n_problems, "problem {problem} of {}", self.n_problems);
        self.h[pair * self.n_groups + problem / LANES].0[problem % LANES] = value;
    }

    /// What is added to the diagonal of one problem, positive.
    ///
    /// # Panics
    /// If there is no such problem.
    pub fn set_ridge(&mut self, problem: usize, ridge: f64) {
        assert!(problem < self.n_problems, "problem {problem} of {}", self.n_problems);
        self.ridge[problem / LANES].0[problem % LANES] = ridge;
    }

    /// Solves all subsets of all problems.
    pub fn solve(&mut self) {
        walk(self);
    }

    /// Weights of one guide in one mask, zero where it is not in it: all groups of eight problems. Lanes past the number of
    /// problems have no meaning.
    ///
    /// # Panics
    /// If there is no such mask or guide.
    #[must_use]
    pub fn weights(&self, mask: usize, guide: usize) -> &[Lane] {
        let at = (mask * self.n_guides + guide) * self.n_groups;
        &self.weights[at..at + self.n_groups]
    }

    /// The weight of one guide in one mask of one problem.
    ///
    /// # Panics
    /// If there is no such mask, guide or problem.
    #[must_use]
    pub fn weight(&self, mask: usize, guide: usize, problem: usize) -> f64 {
        self.weights(mask, guide)[problem / LANES].0[problem % LANES]
    }

    /// The least value of wᵀ (H + ridge) w for one mask of one problem.
    ///
    /// # Panics
    /// If there is no such mask or problem.
    #[must_use]
    pub fn objective(&self, mask: usize, problem: usize) -> f64 {
        self.objective[mask * self.n_groups + problem / LANES].0[problem % LANES]
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn walk(lanes: &mut SubsetLanes) {
    let mut guide_at = [0; MAX_ELIGIBLE];
    for mask in 1..1_usize << lanes.n_guides {
        let last = mask.count_ones() as usize - 1;
        guide_at[last] = mask.trailing_zeros() as usize;
        // Of known size, the loops over a mask's guides unroll and its numbers stay in registers.
        match last + 1 {
            1 => one_mask::<1>(lanes, mask, &guide_at),
            2 => one_mask::<2>(lanes, mask, &guide_at),
            3 => one_mask::<3>(lanes, mask, &guide_at),
            4 => one_mask::<4>(lanes, mask, &guide_at),
            5 => one_mask::<5>(lanes, mask, &guide_at),
            6 => one_mask::<6>(lanes, mask, &guide_at),
            7 => one_mask::<7>(lanes, mask, &guide_at),
            8 => one_mask::<8>(lanes, mask, &guide_at),
            _ => one_mask::<9>(lanes, mask, &guide_at),
        }
    }
}

/// Solves one mask of `SIZE` guides for all groups, all smaller masks being solved.
#[inline(always)]
fn one_mask<const SIZE: usize>(lanes: &mut SubsetLanes, mask: usize, guide_at: &[usize; MAX_ELIGIBLE]) {
    let (k, n_groups) = (lanes.n_guides, lanes.n_groups);
    let guide = guide_at[SIZE - 1];
    let mut row = [0; SIZE];
    for c in 0..SIZE {
        row[c] = pair_index(k, guide, guide_at[c]) * n_groups;
    }
    for group in 0..n_groups {
        let ridge = &lanes.ridge[group];
        let factor = &mut lanes.factors[group];
        let mut h = [ZERO; SIZE];
        unrolled!(c < SIZE, { h[c] = lanes.h[row[c] + group] });
        let x = inner_optimum(factor, &h, ridge);
        let mut total = x[SIZE - 1];
        let mut least = x[SIZE - 1];
        unrolled!(SIZE - 1, down to r, {
            total = add(&total, &x[r]);
            least = smaller(&least, &x[r]);
        });
        let mut best = inverse(&total);
        let mut weights = [ZERO; SIZE];
        unrolled!(r < SIZE, { weights[r] = mul(&x[r], &best) });
        if SIZE > 1 && any_negative(&least) {
            // Nothing is better than a lane's optimum where that is inside.
            best = pick(&negative_and_less(&least, &ZERO, &ONE), &Lane([f64::INFINITY; LANES]), &best);
            unrolled!(SIZE, down to left_out, {
                if any_negative(&x[left_out]) {
                    let child = mask & !(1 << guide_at[left_out]);
                    let objective = &lanes.objective[child * n_groups + group];
                    let better = negative_and_less(&x[left_out], objective, &best);
                    best = pick(&better, objective, &best);
                    for r in 0..SIZE {
                        let of_child = &lanes.weights[(child * k + guide_at[r]) * n_groups + group];
                        weights[r] = pick(&better, of_child, &weights[r]);
                    }
                }
            });
        }
        lanes.objective[mask * n_groups + group] = best;
        for r in 0..SIZE {
            lanes.weights[(mask * k + guide_at[r]) * n_groups + group] = weights[r];
        }
    }
}

/// H⁻¹1 for `SIZE` guides, from the factor of all but the last, which grows by a row. `h` holds the last guide's products
/// with those before it, then with itself.
#[allow(unused_assignments, reason = "the last of the unrolled steps has none after it")]
#[inline(always)]
fn inner_optimum<const SIZE: usize>(factor: &mut Factor, h: &[Lane; SIZE], ridge: &Lane) -> [Lane; SIZE] {
    let last = SIZE - 1;
    let mut pivot = add(&h[last], ridge);
    let mut ahead = ONE;
    let mut unscaled = [ZERO; SIZE];
    unrolled!(c < last, {
        let mut sum = h[c];
        unrolled!(t < c, { sum = less_product(&unscaled[t], &factor.rows[c][t], &sum) });
        unscaled[c] = sum;
        let entry = mul(&sum, &factor.inverse_pivot[c]);
        factor.rows[last][c] = entry;
        pivot = less_product(&entry, &sum, &pivot);
        ahead = less_product(&entry, &factor.forward[c], &ahead);
    });
    factor.inverse_pivot[last] = inverse(&larger(&pivot, ridge));
    factor.forward[last] = ahead;
    factor.scaled[last] = mul(&ahead, &factor.inverse_pivot[last]);

    let mut x = [ZERO; SIZE];
    unrolled!(r < SIZE, { x[r] = factor.scaled[r] });
    unrolled!(SIZE, down to t, {
        unrolled!(r < t, { x[r] = less_product(&factor.rows[t][r], &x[t], &x[r]) });
    });
    x
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::subset_weights::{SubsetWeights, ridge};

    /// Gram matrices of residuals of `k` guides, degenerate ones among them.
    fn problems(rng: &mut Pcg64Mcg, k: usize, n: usize) -> Vec<(Square, f64)> {
        (0..n)
            .map(|at| {
                let n_rows = [1, 3, 8, 40][at % 4];
                let shared: Vec<f64> = (0..n_rows).map(|_| rng.random_range(-1.0..1.0)).collect();
                let size = [0.0, 0.01, 1.0][at % 3];
                let mut of_guides: Vec<Vec<f64>> =
                    (0..k).map(|_| shared.iter().map(|c| c + size * rng.random_range(-1.0..1.0)).collect()).collect();
                match at % 7 {
                    // All guides the same; two of them; one without error; none with any.
                    1 => of_guides = vec![shared; k],
                    2 => of_guides[0] = of_guides[k - 1].clone(),
                    3 => of_guides[k / 2].fill(0.0),
                    4 => of_guides.iter_mut().for_each(|g| g.fill(0.0)),
                    _ => {}
                }
                let mut h = [[0.0; MAX_ELIGIBLE]; MAX_ELIGIBLE];
                for a in 0..k {
                    for b in 0..k {
                        h[a][b] = of_guides[a].iter().zip(&of_guides[b]).map(|(x, y)| x * y).sum();
                    }
                }
                (h, ridge(&h, k, n_rows))
            })
            .collect()
    }

    fn check(lanes: &mut SubsetLanes, k: usize, problems: &[(Square, f64)]) {
        lanes.reset(k, problems.len());
        for (at, (h, ridge)) in problems.iter().enumerate() {
            lanes.set(at, h, *ridge);
        }
        lanes.solve();
        let mut plain = SubsetWeights::default();
        for (at, (h, ridge)) in problems.iter().enumerate() {
            plain.solve(h, k, *ridge);
            for mask in 1..1_usize << k {
                let (ours, expected) = (lanes.objective(mask, at), plain.objective(mask as u16));
                assert_eq!(ours.to_bits(), expected.to_bits(), "problem {at}, mask {mask:b}: {ours:e} {expected:e}");
                for g in 0..k {
                    let (ours, expected) = (lanes.weight(mask, g, at), plain.of(mask as u16)[g]);
                    assert_eq!(ours.to_bits(), expected.to_bits(), "problem {at}, mask {mask:b}, guide {g}");
                }
            }
        }
    }

    #[test]
    fn every_lane_has_the_bits_of_the_plain_walk() {
        let mut rng = Pcg64Mcg::seed_from_u64(17);
        let mut lanes = SubsetLanes::default();
        for k in 1..=MAX_ELIGIBLE {
            // One lane, whole groups, a group and some; the same memory for all, twice in a row of one shape.
            for n in [1, 8, 24, 27, 30, 7] {
                check(&mut lanes, k, &problems(&mut rng, k, n));
            }
        }
    }

    #[test]
    fn lanes_left_over_say_nothing_but_are_numbers() {
        let mut rng = Pcg64Mcg::seed_from_u64(3);
        let mut lanes = SubsetLanes::default();
        check(&mut lanes, 5, &problems(&mut rng, 5, 3));
        for mask in 1..1 << 5 {
            for g in 0..5 {
                assert!(lanes.weights(mask, g).iter().all(|w| w.0.iter().all(|w| (0.0..=1.0).contains(w))));
            }
        }
    }
}
