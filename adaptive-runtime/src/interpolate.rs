//! Skinning of one strand (AS16 Eq. 5, 6), lanes along the strand; the arithmetic is in [`kernels`].
//!
//! All particles of a hair share one guide set, so nothing is gathered: a guide's transforms are three or twelve arrays over
//! particle index, the quadratic weight is evaluated in the lane. Transforms are kept as what they add to the identity, so
//! a hair at rest is reproduced exactly.

use crate::kernels::{self, LANES, run};
use crate::offset::Return;
use crate::solid_in_head::Frame;
use io_formats::guide_transform::{Blend, DisplacementTransform};
use io_formats::skinning_model::{MAX_ELIGIBLE, WeightPoly};

/// Most particles of a strand, padding included.
pub(crate) const MAX_PARTICLES: usize = 64;

/// Arrays of a transform: three of `offset`, and nine of `linear` if it turns.
pub(crate) const fn arrays(turning: bool) -> usize {
    if turning { 12 } else { LINEAR }
}

/// First array of the turn.
pub(crate) const LINEAR: usize = 3;

/// Particle count padded to whole vectors.
pub(crate) fn padded(n_particles: usize) -> usize {
    n_particles.next_multiple_of(LANES)
}

/// How far a guide moves what it leads in a step.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Travelled {
    /// Its own particles, cm.
    pub moved: f32,
    /// More for each centimetre from them.
    pub turned: f32,
}

impl Travelled {
    /// The most that it moves what rests at most `farthest` cm from its own particles, cm.
    pub(crate) fn within(self, farthest: f32) -> f32 {
        self.moved + self.turned * farthest
    }
}

/// Current transforms of all guides: guide-major, then by [`LANES`] particles, then [`arrays`] rows of that many values, so that what
/// eight particles need of a guide lies in one piece; padding repeats the tip.
#[derive(Clone, Debug)]
pub(crate) struct TransformArrays {
    pub pad: usize,
    /// Whether any transform turns; if not, there are no arrays of `linear`.
    pub turning: bool,
    values: Vec<f32>,
}

impl TransformArrays {
    pub(crate) fn new(n_guides: usize, n_particles: usize, blend: Blend) -> Self {
        let pad = padded(n_particles);
        let turning = blend == Blend::Rigid;
        Self { pad, turning, values: vec![0.0; n_guides * arrays(turning) * pad] }
    }

    /// All values, guide-major.
    pub(crate) fn all(&self) -> &[f32] {
        &self.values
    }

    /// Where value `array` of a guide's particle is.
    fn index(&self, guide: usize, array: usize, particle: usize) -> usize {
        let block = guide * (self.pad / LANES) + particle / LANES;
        (block * arrays(self.turning) + array) * LANES + particle % LANES
    }

    /// Takes over another head's transforms of the same size.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.turning = other.turning;
        self.values.copy_from_slice(&other.values);
    }

    /// How far a guide has moved its own particles since `before`, which rest in `rest`, seen from what `carries` moves meanwhile; and
    /// how much farther for each centimetre that a particle rests from the guide's own: at most, cm and 1.
    pub(crate) fn travel_since(&self, before: &Self, guide: usize, rest: &[[f32; 3]], carries: &Frame) -> Travelled {
        let mut moved2 = 0.0f32;
        let mut turned2 = 0.0f32;
        for (i, &r) in rest.iter().enumerate() {
            let (now, old) = (self.place(guide, i, r), carries.point(before.place(guide, i, r)));
            moved2 = moved2.max((0..3).map(|c| (now[c] - old[c]) * (now[c] - old[c])).sum());
            let mut turned = 0.0;
            for col in 0..3 {
                let (now, old) = (self.column(guide, i, col), carries.vector(before.column(guide, i, col)));
                turned += (0..3).map(|c| (now[c] - old[c]) * (now[c] - old[c])).sum::<f32>();
            }
            turned2 = turned2.max(turned);
        }
        // The largest stretch of a difference of rotations is its Frobenius norm over the root of two.
        Travelled { moved: moved2.sqrt(), turned: (0.5 * turned2).sqrt() }
    }

    /// Where a guide's transform at a particle takes a point of the head at rest.
    fn place(&self, guide: usize, particle: usize, rest: [f32; 3]) -> [f32; 3] {
        let value = |array: usize| self.values[self.index(guide, array, particle)];
        std::array::from_fn(|row| {
            let turned = |col: usize| if self.turning { value(LINEAR + 3 * row + col) * rest[col] } else { 0.0 };
            rest[row] + (turned(0) + turned(1) + turned(2)) + value(row)
        })
    }

    /// Column of the rotation of a guide's transform.
    fn column(&self, guide: usize, particle: usize, col: usize) -> [f32; 3] {
        std::array::from_fn(|row| {
            let turn =
                if self.turning { self.values[self.index(guide, LINEAR + 3 * row + col, particle)] } else { 0.0 };
            turn + if row == col { 1.0 } else { 0.0 }
        })
    }

    /// [`Self::set_guide`] of a guide that only moves what is near it: what its particles have moved by, cm.
    pub(crate) fn set_guide_moved(&mut self, guide: usize, rest: &[[f32; 3]], current: &[[f32; 3]]) {
        for i in 0..self.pad {
            let from = i.min(rest.len() - 1);
            for c in 0..3 {
                let at = self.index(guide, c, i);
                self.values[at] = current[from][c] - rest[from][c];
            }
        }
    }

    pub(crate) fn set_guide(&mut self, guide: usize, transforms: &[DisplacementTransform]) {
        for i in 0..self.pad {
            let t = &transforms[i.min(transforms.len() - 1)];
            for row in 0..3 {
                let at = self.index(guide, row, i);
                self.values[at] = t.offset[row];
                for col in (0..3).filter(|_| self.turning) {
                    let at = self.index(guide, LINEAR + 3 * row + col, i);
                    self.values[at] = t.linear[row][col];
                }
            }
        }
    }
}

/// A strand's guide set with its weights decoded.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ActiveSet {
    pub n: u8,
    pub guides: [u16; MAX_ELIGIBLE],
    pub weights: [WeightPoly; MAX_ELIGIBLE],
}

impl ActiveSet {
    pub(crate) const EMPTY: Self =
        Self { n: 0, guides: [0; MAX_ELIGIBLE], weights: [WeightPoly { quad: 0.0, lin: 0.0, con: 0.0 }; MAX_ELIGIBLE] };

    /// Weights at `u` along the strand, clamped and normalised; entries past `n` are zero.
    pub(crate) fn weights_at(&self, u: f32) -> [f32; MAX_ELIGIBLE] {
        let mut w = [0.0; MAX_ELIGIBLE];
        let mut sum = 0.0;
        for b in 0..usize::from(self.n) {
            w[b] = self.weights[b].at(u).max(0.0);
            sum += w[b];
        }
        for x in &mut w[..usize::from(self.n)] {
            *x = if sum > 0.0 { *x / sum } else { 1.0 / f32::from(self.n) };
        }
        w
    }
}

/// Interpolates one strand in the head frame.
/// Implements AS16 Eq. (5), weights by AS16 Eq. (6) clamped at zero and normalised at each particle.
///
/// `rest` and `out` hold three arrays (x, y, z) of `pad` values; `u` the particles' positions along the strand, 0 to 1.
pub(crate) fn interpolate(rest: &[f32], u: &[f32], set: &ActiveSet, transforms: &TransformArrays, out: &mut [f32]) {
    run(kernels::Blend { rest, u, set, transforms, out });
}

/// As [`interpolate`], with what the strand carries (offset and velocity, three arrays of `pad` values each, some time ago), moved by
/// `frame` where there is one, as points; `skin` is room for three arrays.
pub(crate) fn interpolate_to_points(
    rest: &[f32],
    u: &[f32],
    set: &ActiveSet,
    transforms: &TransformArrays,
    carried: Option<(&[f32], Return)>,
    frame: Option<&Frame>,
    skin: &mut [f32],
    out: &mut [[f32; 3]],
) {
    run(kernels::Points {
        blend: kernels::Blend { rest, u, set, transforms, out: skin },
        carried,
        frame,
        points: out.as_flattened_mut(),
    });
}

/// The plain reading of AS16 Eq. (5) for one particle: the reference that [`interpolate`] is tested against.
#[cfg(test)]
pub(crate) fn interpolate_plainly(
    rest: [f32; 3],
    u: f32,
    set: &ActiveSet,
    transforms: &[DisplacementTransform],
) -> [f32; 3] {
    let weights = set.weights_at(u);
    let mut out = [0.0; 3];
    for b in 0..usize::from(set.n) {
        let moved = transforms[b].apply(rest);
        for c in 0..3 {
            out[c] += weights[b] * moved[c];
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use io_formats::guide_transform::guide_transforms;

    /// Single-precision rounding over coordinates of some tens of centimetres.
    const ROUND_OFF_CM: f32 = 2e-5;

    fn strand(x: f32, bend: f32) -> Vec<[f32; 3]> {
        (0..25).map(|i| i as f32).map(|i| [x + bend * i * i, -i, 0.3 * (bend * i).sin()]).collect()
    }

    fn three_guides(bend: f32, kind: Blend) -> (TransformArrays, Vec<Vec<DisplacementTransform>>) {
        let mut arrays = TransformArrays::new(3, 25, kind);
        let mut plain = Vec::new();
        for g in 0..3 {
            let mut transforms = vec![DisplacementTransform::default(); 25];
            let bent = strand(g as f32, bend * (1.0 + g as f32));
            guide_transforms(&strand(g as f32, 0.0), &bent, kind, &mut transforms);
            arrays.set_guide(g, &transforms);
            plain.push(transforms);
        }
        (arrays, plain)
    }

    fn set() -> ActiveSet {
        let mut set = ActiveSet { n: 3, guides: [0; MAX_ELIGIBLE], ..ActiveSet::EMPTY };
        set.guides[..3].copy_from_slice(&[0, 1, 2]);
        set.weights[0] = WeightPoly { quad: 0.2, lin: -0.5, con: 0.6 };
        set.weights[1] = WeightPoly { quad: -0.3, lin: 0.1, con: 0.3 };
        set.weights[2] = WeightPoly { quad: 0.1, lin: 0.4, con: 0.1 };
        set
    }

    fn soa(points: &[[f32; 3]], pad: usize) -> Vec<f32> {
        (0..3).flat_map(|c| (0..pad).map(move |i| points[i.min(points.len() - 1)][c])).collect()
    }

    fn run(rest: &[[f32; 3]], arrays: &TransformArrays) -> Vec<[f32; 3]> {
        let pad = padded(rest.len());
        let u: Vec<f32> = (0..pad).map(|i| (i as f32 / 24.0).min(1.0)).collect();
        let mut out = vec![0.0; 3 * pad];
        interpolate(&soa(rest, pad), &u, &set(), arrays, &mut out);
        (0..rest.len()).map(|i| [out[i], out[pad + i], out[2 * pad + i]]).collect()
    }

    #[test]
    fn a_hair_at_rest_is_reproduced_exactly() {
        let rest = strand(0.7, 0.011);
        for kind in [Blend::Rigid, Blend::Translation] {
            let (arrays, _) = three_guides(0.0, kind);
            assert_eq!(run(&rest, &arrays), rest);
        }
    }

    #[test]
    fn the_kernel_agrees_with_the_plain_equation() {
        let rest = strand(0.7, 0.0);
        for kind in [Blend::Rigid, Blend::Translation] {
            let (arrays, plain) = three_guides(0.01, kind);
            for (i, p) in run(&rest, &arrays).iter().enumerate() {
                let per_guide: Vec<_> = plain.iter().map(|t| t[i]).collect();
                let expected = interpolate_plainly(rest[i], i as f32 / 24.0, &set(), &per_guide);
                for c in 0..3 {
                    assert!((p[c] - expected[c]).abs() < ROUND_OFF_CM);
                }
            }
        }
    }

    #[test]
    fn weights_are_not_negative_and_sum_to_one_at_every_particle() {
        let mut set = set();
        set.weights[1].con = -0.2;
        for i in 0..25 {
            let w = set.weights_at(i as f32 / 24.0);
            assert!(w.iter().all(|&x| x >= 0.0));
            assert!((w.iter().sum::<f32>() - 1.0).abs() < 1e-6);
        }
    }
}
