//! Which kept set serves for a combination of guides that training discarded.
//!
//! At runtime a strand's guides are what a cluster leaves of its eligible ones, any of the 2^k - 1 masks, also those that
//! AS16 Algorithm 2 discards; the paper does not say what happens then. Here each mask has a kept set standing in: itself
//! if kept, else of all kept subsets the one that trained best. Always a subset: a guide the cluster excludes must not
//! come back. Single guides are always kept, so there is one for every mask.

/// For each mask m of `k` guides, at entry m - 1: index into `masks` of the kept set standing in. `masks` are ascending and
/// hold all single guides; `errors` are their training errors. Of equal errors the lower mask wins.
///
/// # Panics
/// If the two slices differ in length, or a mask has no kept subset.
#[must_use]
pub fn stand_ins(k: usize, masks: &[u16], errors: &[f32]) -> Vec<u16> {
    assert_eq!(masks.len(), errors.len(), "one error per kept set");
    let n = 1_usize << k;
    let mut kept = vec![None; n];
    for (index, &mask) in masks.iter().enumerate() {
        kept[usize::from(mask)] = Some(index);
    }
    // By mask, the best kept set among all its subsets, itself included.
    let mut best: Vec<Option<usize>> = vec![None; n];
    let better = |a: usize, b: usize| errors[a].total_cmp(&errors[b]).then(masks[a].cmp(&masks[b])).is_lt();
    let mut out = Vec::with_capacity(n - 1);
    for mask in 1..n {
        let mut found = kept[mask];
        for g in (0..k).filter(|g| mask >> g & 1 == 1) {
            if let Some(candidate) = best[mask & !(1 << g)]
                && found.is_none_or(|f| better(candidate, f))
            {
                found = Some(candidate);
            }
        }
        best[mask] = found;
        let standing = kept[mask].or(found);
        assert!(standing.is_some(), "mask {mask:#b} has no kept subset: single guides must be kept");
        out.push(standing.unwrap_or(0) as u16);
    }
    out
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    #[test]
    fn a_stand_in_is_the_best_trained_kept_subset() {
        let mut rng = Pcg64Mcg::seed_from_u64(11);
        for k in 1..=9 {
            for keep in [0.0, 0.2, 0.9] {
                let mut masks = Vec::new();
                for mask in 1..1_u16 << k {
                    if mask.count_ones() == 1 || rng.random_bool(keep) {
                        masks.push(mask);
                    }
                }
                let errors: Vec<f32> = masks.iter().map(|_| rng.random_range(0.0..1.0)).collect();
                let found = stand_ins(k, &masks, &errors);
                assert_eq!(found.len(), (1 << k) - 1);
                for mask in 1..1_u16 << k {
                    let standing = usize::from(found[usize::from(mask) - 1]);
                    assert_eq!(masks[standing] & !mask, 0, "{:#b} for {mask:#b}", masks[standing]);
                    if let Ok(itself) = masks.binary_search(&mask) {
                        assert_eq!(standing, itself, "a kept set stands for itself");
                    } else {
                        let best = (0..masks.len()).filter(|&i| masks[i] & !mask == 0).map(|i| errors[i]);
                        assert_eq!(errors[standing], best.fold(f32::INFINITY, f32::min));
                    }
                }
            }
        }
    }
}
