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

/// One number for each of eight problems.
pub type Lane = [f64; LANES];

const ZERO: Lane = [0.0; LANES];

macro_rules! lanewise {
    ($(#[$doc:meta])* $name:ident($($x:ident),+) = $value:expr) => {
        $(#[$doc])*
        #[inline(always)]
        fn $name($($x: &Lane),+) -> Lane {
            let mut out = ZERO;
            for at in 0..LANES {
                $(let $x = $x[at];)+
                out[at] = $value;
            }
            out
        }
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
    /// The larger of both.
    larger(a, b) = a.max(b)
);
lanewise!(
    /// 1 / a
    inverse(a) = 1.0 / a
);

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
#[derive(Debug, Clone, Default)]
struct Factor {
    /// Below the unit diagonal.
    rows: [[Lane; MAX_ELIGIBLE]; MAX_ELIGIBLE],
    inverse_pivot: [Lane; MAX_ELIGIBLE],
    /// L⁻¹ 1, and that over the pivots.
    forward: [Lane; MAX_ELIGIBLE],
    scaled: [Lane; MAX_ELIGIBLE],
}

impl SubsetLanes {
    /// Makes room for `n_problems` of `n_guides` each; problems that are not [`set`](Self::set) have no meaning.
    ///
    /// # Panics
    /// If there are not 1 to 9 guides.
    pub fn reset(&mut self, n_guides: usize, n_problems: usize) {
        assert!((1..=MAX_ELIGIBLE).contains(&n_guides), "{n_guides} eligible guides");
        (self.n_guides, self.n_problems) = (n_guides, n_problems);
        self.n_groups = n_problems.div_ceil(LANES);
        let refill = |lanes: &mut Vec<Lane>, per_group: usize, value: f64| {
            lanes.clear();
            lanes.resize(per_group * self.n_groups, [value; LANES]);
        };
        refill(&mut self.h, n_guides * (n_guides + 1) / 2, 0.0);
        // Lanes left over solve zero matrices.
        refill(&mut self.ridge, 1, 1.0);
        let n_masks = 1 << n_guides;
        // Every mask writes all its own weights; what lies outside is zero from here on unless the shape changes.
        refill(&mut self.weights, n_masks * n_guides, 0.0);
        refill(&mut self.objective, n_masks, 0.0);
        self.factors.resize_with(self.n_groups, Factor::default);
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
        self.h[pair * self.n_groups + problem / LANES][problem % LANES] = value;
    }

    /// What is added to the diagonal of one problem, positive.
    ///
    /// # Panics
    /// If there is no such problem.
    pub fn set_ridge(&mut self, problem: usize, ridge: f64) {
        assert!(problem < self.n_problems, "problem {problem} of {}", self.n_problems);
        self.ridge[problem / LANES][problem % LANES] = ridge;
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
        self.weights(mask, guide)[problem / LANES][problem % LANES]
    }

    /// The least value of wᵀ (H + ridge) w for one mask of one problem.
    ///
    /// # Panics
    /// If there is no such mask or problem.
    #[must_use]
    pub fn objective(&self, mask: usize, problem: usize) -> f64 {
        self.objective[mask * self.n_groups + problem / LANES][problem % LANES]
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
        for c in 0..SIZE {
            h[c] = lanes.h[row[c] + group];
        }
        let x = inner_optimum(factor, &h, ridge);
        let mut total = x[SIZE - 1];
        let mut least = x[SIZE - 1];
        for r in (0..SIZE - 1).rev() {
            total = add(&total, &x[r]);
            for at in 0..LANES {
                least[at] = least[at].min(x[r][at]);
            }
        }
        let mut best = inverse(&total);
        let mut weights = [ZERO; SIZE];
        for r in 0..SIZE {
            weights[r] = mul(&x[r], &best);
        }
        if SIZE > 1 && least.iter().any(|x| *x < 0.0) {
            let inside = least.map(|x| if x < 0.0 { f64::INFINITY } else { 0.0 });
            // Nothing is better than a lane's optimum where that is inside.
            for at in 0..LANES {
                best[at] = if inside[at] == 0.0 { best[at] } else { f64::INFINITY };
            }
            for left_out in (0..SIZE).rev() {
                if !x[left_out].iter().any(|x| *x < 0.0) {
                    continue;
                }
                let child = mask & !(1 << guide_at[left_out]);
                let objective = &lanes.objective[child * n_groups + group];
                let mut better = [false; LANES];
                for at in 0..LANES {
                    better[at] = (x[left_out][at] < 0.0) & (objective[at] < best[at]);
                    best[at] = if better[at] { objective[at] } else { best[at] };
                }
                for r in 0..SIZE {
                    let of_child = &lanes.weights[(child * k + guide_at[r]) * n_groups + group];
                    for at in 0..LANES {
                        weights[r][at] = if better[at] { of_child[at] } else { weights[r][at] };
                    }
                }
            }
        }
        lanes.objective[mask * n_groups + group] = best;
        for r in 0..SIZE {
            lanes.weights[(mask * k + guide_at[r]) * n_groups + group] = weights[r];
        }
    }
}

/// H⁻¹1 for `SIZE` guides, from the factor of all but the last, which grows by a row. `h` holds the last guide's products
/// with those before it, then with itself.
#[inline(always)]
fn inner_optimum<const SIZE: usize>(factor: &mut Factor, h: &[Lane; SIZE], ridge: &Lane) -> [Lane; SIZE] {
    let last = SIZE - 1;
    let mut pivot = add(&h[last], ridge);
    let mut ahead = [1.0; LANES];
    let mut unscaled = [ZERO; SIZE];
    for c in 0..last {
        let mut sum = h[c];
        for t in 0..c {
            sum = less_product(&unscaled[t], &factor.rows[c][t], &sum);
        }
        unscaled[c] = sum;
        let entry = mul(&sum, &factor.inverse_pivot[c]);
        factor.rows[last][c] = entry;
        pivot = less_product(&entry, &sum, &pivot);
        ahead = less_product(&entry, &factor.forward[c], &ahead);
    }
    factor.inverse_pivot[last] = inverse(&larger(&pivot, ridge));
    factor.forward[last] = ahead;
    factor.scaled[last] = mul(&ahead, &factor.inverse_pivot[last]);

    let mut x = [ZERO; SIZE];
    x.copy_from_slice(&factor.scaled[..SIZE]);
    for t in (1..SIZE).rev() {
        for r in 0..t {
            x[r] = less_product(&factor.rows[t][r], &x[t], &x[r]);
        }
    }
    x
}
