//! Where strands are near a solid: walks along many strands at once, in steps that grow with the distance.
//!
//! A distance changes by at most the length walked. So what lies between two places is surely farther than half of their distances
//! together less the length between them, and a walk may take long steps far from the solid and short ones near it. The walks
//! of a group of strands advance together: the samples of one round are taken in one batch, which is what makes
//! them cheap. Each strand's walk is its own, so what is found does not depend on the strands beside it.

use crate::kernels::LANES;
use crate::solid_in_head::particle;
use crate::strands::GROUP;
use collision::{Samples, SignedDistanceField};
use multiversion::multiversion;
use nalgebra::Vector3;

/// Length of a step as a share of the distance: a place where the distance is least is that much off at most.
const STEP_OVER_DISTANCE: f32 = 0.5;

/// Most steps to a segment: guards against a spacing of zero.
const MOST_STEPS: f32 = 64.0;

/// Square of the slope below which a sample has no direction of its own.
const LEAST_SLOPE2: f32 = 1e-4;

/// A place where a strand's distance to a solid is least among its neighbours.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Nearest {
    pub segment: u16,
    pub s: f32,
    /// Signed distance, cm.
    pub distance: f32,
    /// Where that is and the unit normal there, in the solid's frame.
    pub point: [f32; 3],
    pub normal: [f32; 3],
}

/// The solid looked at, and how closely.
#[derive(Clone, Copy)]
pub(crate) struct Sight<'a> {
    pub field: &'a SignedDistanceField,
    /// Particles that count.
    pub first: usize,
    pub end: usize,
    /// Distance below which places are wanted, cm.
    pub reach: f32,
    /// Distance between samples where the solid is near, cm.
    pub spacing: f32,
}

/// Strands in the solid's frame: each three arrays of `pad` values, cm.
#[derive(Clone, Copy)]
pub(crate) struct Particles<'a> {
    pub x: &'a [f32],
    pub pad: usize,
}

/// Walks along the strands of a group, a value for each in every array, so that a round advances eight to an instruction.
#[derive(Clone, Debug)]
struct Walks {
    strand: [u32; GROUP],
    /// Place of the next sample, in particles.
    along: [f32; GROUP],
    /// Bound on the length of a segment, cm.
    longest: [f32; GROUP],
    /// Places of the last sample and of the one before, and the distances there.
    last_along: [f32; GROUP],
    last: [f32; GROUP],
    before_along: [f32; GROUP],
    before: [f32; GROUP],
    /// What all that was walked past is surely not nearer than, cm.
    clear: [f32; GROUP],
    /// What this round is to the walk: [`IS_LEAST`], [`ENDS`].
    event: [u32; GROUP],
}

/// The last sample is less than the one before, and not more than this one.
const IS_LEAST: u32 = 1;
/// This sample is the walk's last, and [`ENDS_LEAST`]: less than the one before.
const ENDS: u32 = 2;
const ENDS_LEAST: u32 = 4;

/// What a round of walks compares with.
#[derive(Clone, Copy)]
struct Limits<'a> {
    field: &'a SignedDistanceField,
    reach: f32,
    spacing: f32,
    /// The last particle.
    end: f32,
}

impl Walks {
    const NONE: Self = Self {
        strand: [0; GROUP],
        along: [0.0; GROUP],
        longest: [1.0; GROUP],
        last_along: [f32::NAN; GROUP],
        last: [f32::INFINITY; GROUP],
        before_along: [f32::NAN; GROUP],
        before: [f32::INFINITY; GROUP],
        clear: [f32::INFINITY; GROUP],
        event: [0; GROUP],
    };

    /// Where the distance is least, if the last sample of walk `k` is less than those beside it: the vertex of the parabola through the three.
    /// Samples alone would place it now here, now there, and a strand on a round solid would tremble by what their distances differ.
    fn least_along(&self, k: usize, distance: f32) -> f32 {
        let (along, last, last_along) = (self.along[k], self.last[k], self.last_along[k]);
        let (to_before, to_next) = (last_along - self.before_along[k], last_along - along);
        let (over_next, over_before) = (last - distance, last - self.before[k]);
        let below = to_before * over_next - to_next * over_before;
        let shift = 0.5 * (to_before * to_before * over_next - to_next * to_next * over_before) / below;
        if shift.is_finite() { (last_along - shift).clamp(self.before_along[k], along) } else { last_along }
    }

    /// Puts walk `from` in the place of walk `to`.
    fn put(&mut self, to: usize, from: usize) {
        self.strand[to] = self.strand[from];
        let Self { along, longest, last_along, last, before_along, before, clear, .. } = self;
        for values in [along, longest, last_along, last, before_along, before, clear] {
            values[to] = values[from];
        }
    }
}

/// Says what samples at the places of the first `n` walks are to them.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn compare(walks: &mut Walks, n: usize, distance: &[f32; GROUP], reach: f32, end: f32) {
    for k in 0..n.next_multiple_of(LANES).min(GROUP) {
        let (last, now) = (walks.last[k], distance[k]);
        let is_least = (last < reach) & !((walks.before[k] <= last) | (now < last));
        let ends = walks.along[k] >= end;
        let ends_least = ends & (now < reach) & ((last > now) | last.is_nan());
        walks.event[k] = u32::from(is_least) * IS_LEAST + u32::from(ends) * ENDS + u32::from(ends_least) * ENDS_LEAST;
    }
}

/// Takes the samples over, and each walk as far as nothing in reach can be missed.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn advance(walks: &mut Walks, n: usize, distance: &[f32; GROUP], limits: Limits) {
    let Limits { field, reach, spacing, end } = limits;
    for k in 0..n.next_multiple_of(LANES).min(GROUP) {
        let (along, last_along, longest) = (walks.along[k], walks.last_along[k], walks.longest[k]);
        let (last, now) = (walks.last[k], distance[k]);
        let (last_sure, sure) = (field.surely(last), field.surely(now));
        let between = 0.5 * (last_sure + sure - (along - last_along) * longest);
        let counts = !((last < reach) & (now < reach)) & (last_along >= 0.0);
        let mut clear = walks.clear[k];
        clear = if counts & (between < clear) { between } else { clear };
        // Not a number clears nothing.
        walks.clear[k] = if now.is_nan() { f32::NEG_INFINITY } else { clear };
        (walks.before_along[k], walks.before[k]) = (last_along, last);
        (walks.last_along[k], walks.last[k]) = (along, now);
        let (share, beyond) = (STEP_OVER_DISTANCE * sure, sure - reach);
        let mut step = if share > spacing { share } else { spacing };
        step = if beyond > step { beyond } else { step } / longest;
        step = if step > 1.0 / MOST_STEPS { step } else { 1.0 / MOST_STEPS };
        let next = along + step;
        walks.along[k] = if next < end { next } else { end };
    }
}

/// Buffers of a worker.
#[derive(Clone, Debug)]
pub(crate) struct Look {
    walks: Walks,
    /// What was found: strand, and place along it in particles.
    found: Vec<(u32, f32)>,
    point: [Vec<f32>; 3],
    distance: Vec<f32>,
    gradient: [Vec<f32>; 3],
}

impl Default for Look {
    fn default() -> Self {
        let room = || vec![0.0; GROUP];
        Self {
            walks: Walks::NONE,
            found: Vec::new(),
            point: [room(), room(), room()],
            distance: room(),
            gradient: [room(), room(), room()],
        }
    }
}

impl Look {
    /// Calls `found` with every place of strand `i` (root first) that is nearer than the reach and than the places beside it, and lowers
    /// `clear[i]` (cm) to what all else is surely not nearer than. `longest[i]` (cm) bounds the length of its segments.
    pub(crate) fn along(
        &mut self,
        sight: &Sight,
        strands: Particles,
        longest: &[f32],
        clear: &mut [f32],
        found: &mut impl FnMut(usize, Nearest),
    ) {
        self.found.clear();
        for (k, (longest, clear)) in longest.chunks(GROUP).zip(clear.chunks_mut(GROUP)).enumerate() {
            self.along_group(sight, strands, k * GROUP, longest, clear);
        }
        self.tell(sight, strands, found);
    }

    /// Walks along the strands from `first` on, a group at most.
    fn along_group(&mut self, sight: &Sight, strands: Particles, first: usize, longest: &[f32], clear: &mut [f32]) {
        let Sight { field, first: from, end, reach, spacing } = *sight;
        let limits = Limits { field, reach, spacing, end: (end - 1) as f32 };
        let mut n = longest.len();
        self.walks = Walks { along: [from as f32; GROUP], ..Walks::NONE };
        for (k, &longest) in longest.iter().enumerate() {
            self.walks.strand[k] = (first + k) as u32;
            self.walks.longest[k] = longest;
            self.walks.clear[k] = clear[k];
        }
        while n > 0 {
            for k in 0..n {
                let point = strands.at(self.walks.strand[k] as usize, self.walks.along[k], end);
                (0..3).for_each(|c| self.point[c][k] = point[c]);
            }
            self.sample(field, n);
            let mut distance = [0.0; GROUP];
            distance.copy_from_slice(&self.distance[..GROUP]);
            let walks = &mut self.walks;
            compare(walks, n, &distance, reach, limits.end);
            let mut events = 0;
            for k in 0..n {
                let event = walks.event[k];
                events |= event;
                if event & IS_LEAST != 0 {
                    self.found.push((walks.strand[k], walks.least_along(k, distance[k])));
                }
                if event & ENDS_LEAST != 0 {
                    self.found.push((walks.strand[k], walks.along[k]));
                }
            }
            advance(walks, n, &distance, limits);
            if events & ENDS != 0 {
                let mut kept = 0;
                for k in 0..n {
                    if walks.event[k] & ENDS != 0 {
                        clear[walks.strand[k] as usize - first] = walks.clear[k];
                    } else {
                        walks.put(kept, k);
                        kept += 1;
                    }
                }
                n = kept;
            }
        }
    }

    /// Samples what was found once more, now for its normals too.
    fn tell(&mut self, sight: &Sight, strands: Particles, found: &mut impl FnMut(usize, Nearest)) {
        let n = self.found.len();
        self.fit(n);
        for (k, &(strand, along)) in self.found.iter().enumerate() {
            let point = strands.at(strand as usize, along, sight.end);
            (0..3).for_each(|c| self.point[c][k] = point[c]);
        }
        self.sample(sight.field, n);
        for (k, &(strand, along)) in self.found.iter().enumerate() {
            let point = [self.point[0][k], self.point[1][k], self.point[2][k]];
            let g = [self.gradient[0][k], self.gradient[1][k], self.gradient[2][k]];
            let length2 = g[0] * g[0] + g[1] * g[1] + g[2] * g[2];
            let normal = if length2 > LEAST_SLOPE2 {
                g.map(|x| x / length2.sqrt())
            } else {
                sight.field.outward_normal(Vector3::from(point)).1.into()
            };
            let segment = (along as usize).min(sight.end - 2);
            let s = along - segment as f32;
            let distance = self.distance[k];
            found(strand as usize, Nearest { segment: segment as u16, s, distance, point, normal });
        }
    }

    fn fit(&mut self, n: usize) {
        if self.distance.len() < n {
            self.distance.resize(n, 0.0);
            self.point.iter_mut().chain(&mut self.gradient).for_each(|v| v.resize(n, 0.0));
        }
    }

    /// Samples the first `n` places.
    fn sample(&mut self, field: &SignedDistanceField, n: usize) {
        let [x, y, z] = &self.point;
        let [gx, gy, gz] = &mut self.gradient;
        field.sample(
            [&x[..n], &y[..n], &z[..n]],
            &mut Samples { distance: &mut self.distance[..n], gradient: [&mut gx[..n], &mut gy[..n], &mut gz[..n]] },
        );
    }
}

impl Particles<'_> {
    /// The point of a strand at a place along it, of `end` particles.
    #[inline(always)]
    fn at(&self, strand: usize, along: f32, end: usize) -> [f32; 3] {
        let x = &self.x[strand * 3 * self.pad..(strand + 1) * 3 * self.pad];
        let j = (along as usize).min(end - 2);
        let s = along - j as f32;
        let (a, b) = (particle(x, self.pad, j), particle(x, self.pad, j + 1));
        std::array::from_fn(|c| a[c] + (b[c] - a[c]) * s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_model::Noise;
    use collision::{Shape, ShapeUnion, Solid};

    const N: usize = 25;
    const PAD: usize = 32;
    const SPACING: f32 = 0.06;
    const REACH: f32 = 0.3;
    /// Places to a segment that the walk is compared with.
    const DENSE: usize = 512;

    fn comb() -> Solid {
        let tooth = |k: i32| {
            let x = 0.4 * k as f32;
            Shape::capsule(Vector3::new(x, 0.0, 0.0), Vector3::new(x, 3.0, 0.0), 0.1)
        };
        let comb = ShapeUnion { shapes: (-8..=8).map(tooth).collect(), smoothing: 0.0 };
        Solid::from_shape("comb", &comb, 0.025, 0.1, 0.3).unwrap()
    }

    /// Wavy strands across, along and away from a comb, in the solid's frame.
    fn strands(count: usize) -> Vec<f32> {
        let mut noise = Noise::new(5);
        let mut signed = || 2.0 * noise.next() - 1.0;
        let mut x = vec![0.0; count * 3 * PAD];
        for strand in x.chunks_exact_mut(3 * PAD) {
            let from: [f32; 3] = std::array::from_fn(|c| signed() * [8.0, 3.0, 8.0][c]);
            let to: [f32; 3] = std::array::from_fn(|c| signed() * [3.0, 1.5, 0.6][c] + [0.0, 1.5, 0.0][c]);
            let wave = 0.3 * signed();
            for c in 0..3 {
                for i in 0..PAD {
                    let t = i.min(N - 1) as f32 / 10.0;
                    strand[c * PAD + i] = from[c] + (to[c] - from[c]) * t + wave * (3.0 * t + c as f32).sin();
                }
            }
        }
        x
    }

    fn longest(strand: &[f32]) -> f32 {
        (0..N - 1)
            .map(|i| (Vector3::from(particle(strand, PAD, i)) - Vector3::from(particle(strand, PAD, i + 1))).norm())
            .fold(0.0, f32::max)
    }

    fn looked_at(solid: &Solid, x: &[f32]) -> (Vec<Vec<Nearest>>, Vec<f32>) {
        let longest: Vec<f32> = x.chunks_exact(3 * PAD).map(longest).collect();
        let sight = Sight { field: &solid.sdf, first: 1, end: N, reach: REACH, spacing: SPACING };
        let mut found = vec![Vec::new(); longest.len()];
        let mut clear = vec![f32::INFINITY; longest.len()];
        let mut look = Look::default();
        look.along(&sight, Particles { x, pad: PAD }, &longest, &mut clear, &mut |i, near| found[i].push(near));
        (found, clear)
    }

    #[test]
    fn no_place_nearer_than_the_reach_is_without_one_found_and_all_else_is_as_far_as_said() {
        let (solid, x) = (comb(), strands(300));
        let (found, clear) = looked_at(&solid, &x);
        let (mut n_near, mut n_clear) = (0, 0);
        for ((strand, found), &clear) in x.chunks_exact(3 * PAD).zip(&found).zip(&clear) {
            let step = longest(strand) / DENSE as f32;
            // Stretches nearer than the reach: the least distance of each, and where it is.
            let mut stretch: Option<(f32, f32)> = None;
            for k in DENSE..=(N - 1) * DENSE {
                let (j, s) = ((k / DENSE).min(N - 2), (k - (k / DENSE).min(N - 2) * DENSE) as f32 / DENSE as f32);
                let (a, b) = (Vector3::from(particle(strand, PAD, j)), Vector3::from(particle(strand, PAD, j + 1)));
                let d = solid.sdf.distance(a + (b - a) * s);
                if d < REACH {
                    let along = j as f32 + s;
                    stretch = Some(stretch.filter(|best| best.0 <= d).unwrap_or((d, along)));
                } else {
                    assert!(clear <= d + step, "{clear} cleared, {d} there");
                    n_clear += usize::from(clear > 0.5 * d);
                }
                let ends = d >= REACH || k == (N - 1) * DENSE;
                if let Some((least, along)) = stretch.filter(|_| ends) {
                    stretch = None;
                    // Half a step to either side of the least lies a sample, unless the whole stretch is shorter.
                    let off = 0.5 * SPACING.max(STEP_OVER_DISTANCE * REACH) + step;
                    if least + off < REACH {
                        n_near += 1;
                        let close = |f: &&Nearest| {
                            let apart = (f32::from(f.segment) + f.s - along).abs() * longest(strand);
                            f.distance <= least + off && apart < 1.5
                        };
                        assert!(found.iter().any(|f| close(&f)), "{least} at {along}: {found:?}");
                    }
                }
            }
        }
        assert!(n_near > 100 && n_clear > 10_000, "{n_near} {n_clear}: hardly tried");
    }

    #[test]
    fn where_a_strand_is_nearest_to_a_round_solid_does_not_depend_on_where_samples_fall() {
        /// A quarter of what samples alone are off by here; the field's cells included.
        const OFF_CM: f32 = 5e-4;
        let rod = Shape::capsule(Vector3::new(0.0, 0.0, -3.0), Vector3::new(0.0, 0.0, 3.0), 0.1);
        let rod = ShapeUnion { shapes: vec![rod], smoothing: 0.0 };
        let rod = Solid::from_shape("rod", &rod, 0.025, 0.1, 0.3).unwrap();
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for shift in 0..40 {
            let mut x = vec![0.0; 3 * PAD];
            for i in 0..PAD {
                x[i] = 0.13;
                x[PAD + i] = 12.3 + 0.025 * shift as f32 - i.min(N - 1) as f32;
            }
            let (found, _) = looked_at(&rod, &x);
            let nearest = found[0].iter().map(|near| near.distance).fold(f32::INFINITY, f32::min);
            (low, high) = (low.min(nearest), high.max(nearest));
        }
        assert!(low > 0.03 - OFF_CM && high < 0.03 + OFF_CM, "{low} to {high}");
    }

    #[test]
    fn what_is_found_of_a_strand_does_not_depend_on_those_beside_it() {
        let (solid, x) = (comb(), strands(40));
        let (found, clear) = looked_at(&solid, &x);
        for (i, strand) in x.chunks_exact(3 * PAD).enumerate() {
            let (alone, clear_alone) = looked_at(&solid, strand);
            assert_eq!((&alone[0], clear_alone[0].to_bits()), (&found[i], clear[i].to_bits()));
        }
    }

    #[test]
    fn a_strand_that_is_no_number_ends_the_walk_and_clears_nothing() {
        let (solid, mut x) = (comb(), strands(1));
        x.fill(f32::NAN);
        let (found, clear) = looked_at(&solid, &x);
        assert!(found[0].is_empty() && clear[0] == f32::NEG_INFINITY);
    }
}
