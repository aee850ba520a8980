//! The arithmetic on whole strands, eight particles to an instruction where the machine has it.
//!
//! A strand is three arrays of `pad` values, a multiple of [`LANES`]. Each kernel is the plain loop that its comment states, in the order of the particles;
//! instructions are chosen when the program runs.

use crate::interpolate::{ActiveSet, LINEAR, MAX_PARTICLES, TransformArrays, arrays};
use crate::offset::Return;
use crate::solid_in_head::Frame;
use io_formats::skinning_model::WeightPoly;
use pulp::{Arch, Simd, WithSimd};

/// Particle counts are padded to a multiple of this: no machine's vectors are wider here.
pub(crate) const LANES: usize = 8;

/// Runs a kernel with the widest instructions the machine has.
#[inline(always)]
pub(crate) fn run<K: WithSimd>(kernel: K) -> K::Output {
    Arch::new().dispatch(kernel)
}

#[inline(always)]
fn vectors<S: Simd>(values: &[f32]) -> &[S::f32s] {
    S::as_simd_f32s(values).0
}

#[inline(always)]
fn vectors_mut<S: Simd>(values: &mut [f32]) -> &mut [S::f32s] {
    S::as_mut_simd_f32s(values).0
}

/// AS16 Eq. (5): `out = rest + Σ w_b (linear_b rest + shift_b) / Σ w_b`, weights clamped at zero (AS16 Eq. 6).
pub(crate) struct Blend<'a> {
    pub rest: &'a [f32],
    pub u: &'a [f32],
    pub set: &'a ActiveSet,
    pub transforms: &'a TransformArrays,
    pub out: &'a mut [f32],
}

impl WithSimd for Blend<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { rest, u, set, transforms, out } = self;
        if transforms.turning {
            blend::<S, true>(simd, rest, u, set, transforms, out);
        } else {
            blend::<S, false>(simd, rest, u, set, transforms, out);
        }
    }
}

#[inline(always)]
fn blend<S: Simd, const TURNING: bool>(
    simd: S,
    rest: &[f32],
    u: &[f32],
    set: &ActiveSet,
    transforms: &TransformArrays,
    out: &mut [f32],
) {
    let k = transforms.pad / S::F32_LANES;
    let n = usize::from(set.n).min(set.guides.len());
    let led = Led::<S> {
        guides: &set.guides[..n],
        weights: &set.weights[..n],
        blocks: vectors::<S>(transforms.all()),
        n_blocks: transforms.pad / LANES,
        u: &vectors::<S>(u)[..k],
        rest: thirds(&vectors::<S>(rest)[..3 * k]),
    };
    let mut out = thirds_mut(&mut vectors_mut::<S>(out)[..3 * k]);
    // Two vectors at a time: what is the same for all particles is fetched half as often.
    let mut i = 0;
    while i + 2 <= k {
        led.blend::<TURNING, 2>(simd, i, &mut out);
        i += 2;
    }
    if i < k {
        led.blend::<TURNING, 1>(simd, i, &mut out);
    }
}

/// A strand and what it follows, in vectors.
struct Led<'a, S: Simd> {
    guides: &'a [u16],
    weights: &'a [WeightPoly],
    blocks: &'a [S::f32s],
    n_blocks: usize,
    u: &'a [S::f32s],
    rest: [&'a [S::f32s]; 3],
}

impl<S: Simd> Led<'_, S> {
    /// Vectors `first` and on, `N` of them.
    #[inline(always)]
    fn blend<const TURNING: bool, const N: usize>(&self, simd: S, first: usize, out: &mut [&mut [S::f32s]; 3]) {
        // Vectors to a block of transforms: one where the machine's are as long as the blocks.
        let split = LANES / S::F32_LANES;
        let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
        let u = &self.u[first..first + N];
        let rest = self.rest.map(|x| &x[first..first + N]);
        let (mut sum, mut moved) = ([zero; N], [[zero; N]; 3]);
        for (guide, poly) in self.guides.iter().zip(self.weights) {
            let (quad, lin, con) = (simd.splat_f32s(poly.quad), simd.splat_f32s(poly.lin), simd.splat_f32s(poly.con));
            let base = usize::from(*guide) * self.n_blocks;
            for v in 0..N {
                let i = first + v;
                let block = (base + i / split) * arrays(TURNING) * split;
                let block = &self.blocks[block..block + arrays(TURNING) * split];
                let row = |array: usize| block[array * split + i % split];
                let w = simd.mul_add_f32s(simd.mul_add_f32s(quad, u[v], lin), u[v], con);
                let w = simd.max_f32s(w, zero);
                sum[v] = simd.add_f32s(sum[v], w);
                for c in 0..3 {
                    let mut by = row(c);
                    if TURNING {
                        let of = |col: usize| row(LINEAR + 3 * c + col);
                        let z = simd.mul_add_f32s(of(2), rest[2][v], by);
                        by = simd.mul_add_f32s(of(0), rest[0][v], simd.mul_add_f32s(of(1), rest[1][v], z));
                    }
                    moved[c][v] = simd.mul_add_f32s(w, by, moved[c][v]);
                }
            }
        }
        for v in 0..N {
            // Without a weight the strand stays at rest.
            let weighs = simd.greater_than_f32s(sum[v], zero);
            let scale = simd.select_f32s(weighs, simd.div_f32s(one, sum[v]), zero);
            for c in 0..3 {
                out[c][first + v] = simd.mul_add_f32s(moved[c][v], scale, rest[c][v]);
            }
        }
    }
}

/// The three coordinates of a strand.
#[inline(always)]
fn thirds<T>(values: &[T]) -> [&[T]; 3] {
    let (x, rest) = values.split_at(values.len() / 3);
    let (y, z) = rest.split_at(x.len());
    [x, y, z]
}

#[inline(always)]
fn thirds_mut<T>(values: &mut [T]) -> [&mut [T]; 3] {
    let (x, rest) = values.split_at_mut(values.len() / 3);
    let (y, z) = rest.split_at_mut(x.len());
    [x, y, z]
}

/// [`Blend`], then the offset after some time, then a rigid motion where there is one, as points x, y, z.
pub(crate) struct Points<'a> {
    pub blend: Blend<'a>,
    pub carried: Option<(&'a [f32], Return)>,
    pub frame: Option<&'a Frame>,
    pub points: &'a mut [f32],
}

impl WithSimd for Points<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Blend { rest, u, set, transforms, out } = self.blend;
        let pad = transforms.pad;
        Blend { rest, u, set, transforms, out: &mut *out }.with_simd(simd);
        if let Some((carried, back)) = self.carried {
            let k = 3 * pad / S::F32_LANES;
            let (offset, velocity) = vectors::<S>(carried).split_at(k);
            let [a, b, ..] = back.factors().map(|f| simd.splat_f32s(f));
            for ((x, d), v) in vectors_mut::<S>(out).iter_mut().zip(offset).zip(velocity) {
                *x = simd.add_f32s(*x, simd.mul_add_f32s(a, *d, simd.mul_f32s(b, *v)));
            }
        }
        if let Some(frame) = self.frame {
            let k = pad / S::F32_LANES;
            let x = &mut vectors_mut::<S>(out)[..3 * k];
            for i in 0..k {
                let moved = moved(simd, frame, [x[i], x[k + i], x[2 * k + i]]);
                (x[i], x[k + i], x[2 * k + i]) = moved.into();
            }
        }
        let (x, rest) = out.split_at(pad);
        let (y, z) = rest.split_at(pad);
        let n_values = self.points.len();
        let mut blocks = self.points.chunks_exact_mut(3 * FOUR);
        for (i, block) in blocks.by_ref().enumerate() {
            // Written out in fours, so that each becomes a few shuffles and a store.
            let [x, y, z]: [[f32; FOUR]; 3] = [four(x, i), four(y, i), four(z, i)];
            block[..FOUR].copy_from_slice(&[x[0], y[0], z[0], x[1]]);
            block[FOUR..2 * FOUR].copy_from_slice(&[y[1], z[1], x[2], y[2]]);
            block[2 * FOUR..].copy_from_slice(&[z[2], x[3], y[3], z[3]]);
        }
        let rest = blocks.into_remainder();
        let first = (n_values - rest.len()) / 3;
        for (k, p) in rest.chunks_exact_mut(3).enumerate() {
            (p[0], p[1], p[2]) = (x[first + k], y[first + k], z[first + k]);
        }
    }
}

/// Points written at once.
const FOUR: usize = 4;

#[inline(always)]
fn four(values: &[f32], at: usize) -> [f32; FOUR] {
    let from = &values[at * FOUR..(at + 1) * FOUR];
    std::array::from_fn(|l| from[l])
}

/// A rigid motion of points given by coordinate.
#[inline(always)]
fn moved<S: Simd>(simd: S, frame: &Frame, from: [S::f32s; 3]) -> [S::f32s; 3] {
    let row = |r: usize| {
        let (turn, shift) = frame.row(r);
        let mut sum = simd.splat_f32s(shift);
        for d in 0..3 {
            sum = simd.mul_add_f32s(simd.splat_f32s(turn[d]), from[d], sum);
        }
        sum
    };
    [row(0), row(1), row(2)]
}

/// `out = frame(x)`: a strand in another frame.
pub(crate) struct Turn<'a> {
    pub frame: &'a Frame,
    pub x: &'a [f32],
    pub out: &'a mut [f32],
}

impl WithSimd for Turn<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let x = vectors::<S>(self.x);
        let out = &mut vectors_mut::<S>(self.out)[..x.len()];
        let k = x.len() / 3;
        for i in 0..k {
            let moved = moved(simd, self.frame, [x[i], x[k + i], x[2 * k + i]]);
            (out[i], out[k + i], out[2 * k + i]) = moved.into();
        }
    }
}

/// `x = skin + back(offset, velocity)`: where an offset takes a strand after some time.
pub(crate) struct Carry<'a> {
    pub skin: &'a [f32],
    pub offset: &'a [f32],
    pub velocity: &'a [f32],
    pub back: Return,
    pub x: &'a mut [f32],
}

impl WithSimd for Carry<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let x = vectors_mut::<S>(self.x);
        let (skin, offset, velocity) =
            (vectors::<S>(self.skin), vectors::<S>(self.offset), vectors::<S>(self.velocity));
        let [a, b, ..] = self.back.factors().map(|f| simd.splat_f32s(f));
        for (((x, s), d), v) in x.iter_mut().zip(skin).zip(offset).zip(velocity) {
            *x = simd.add_f32s(*s, simd.mul_add_f32s(a, *d, simd.mul_f32s(b, *v)));
        }
    }
}

/// Offset and velocity after some time, in place.
pub(crate) struct Age<'a> {
    pub offset: &'a mut [f32],
    pub velocity: &'a mut [f32],
    pub back: Return,
}

impl WithSimd for Age<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let [a, b, c, d] = self.back.factors().map(|f| simd.splat_f32s(f));
        let pairs = vectors_mut::<S>(self.offset).iter_mut().zip(vectors_mut::<S>(self.velocity));
        for (x, v) in pairs {
            let now = simd.mul_add_f32s(a, *x, simd.mul_f32s(b, *v));
            *v = simd.mul_add_f32s(c, *x, simd.mul_f32s(d, *v));
            *x = now;
        }
    }
}

/// `x = skin + Σ_j table_j (keeps offset_j + carries velocity_j)`, per coordinate: one step of the linearised strand.
pub(crate) struct StepFreely<'a> {
    /// Rows of `pad` values, the first of which answers particle `first`.
    pub rows: &'a [f32],
    pub first: usize,
    pub pad: usize,
    pub keeps: f32,
    pub carries: f32,
    pub skin: &'a [f32],
    pub offset: &'a [f32],
    pub velocity: &'a [f32],
    pub x: &'a mut [f32],
}

impl WithSimd for StepFreely<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { rows, first, pad, keeps, carries, skin, offset, velocity, x } = self;
        let k = pad / S::F32_LANES;
        let mut right = [0.0f32; 3 * MAX_PARTICLES];
        let right = &mut right[..3 * pad];
        let (keeps, carries) = (simd.splat_f32s(keeps), simd.splat_f32s(carries));
        let pairs = vectors::<S>(offset).iter().zip(vectors::<S>(velocity));
        for (r, (d, v)) in vectors_mut::<S>(right).iter_mut().zip(pairs) {
            *r = simd.mul_add_f32s(keeps, *d, simd.mul_f32s(carries, *v));
        }
        let [right_x, right_y, right_z] = thirds(right).map(|r| &r[first.min(pad)..]);
        let [skin_x, skin_y, skin_z] = thirds(&vectors::<S>(skin)[..3 * k]);
        let [x, y, z] = thirds_mut(&mut vectors_mut::<S>(x)[..3 * k]);
        let rows = vectors::<S>(rows);
        for i in 0..k {
            let (mut sx, mut sy, mut sz) = (skin_x[i], skin_y[i], skin_z[i]);
            let column = rows[i..].iter().step_by(k).zip(right_x).zip(right_y).zip(right_z);
            for (((row, x), y), z) in column {
                sx = simd.mul_add_f32s(simd.splat_f32s(*x), *row, sx);
                sy = simd.mul_add_f32s(simd.splat_f32s(*y), *row, sy);
                sz = simd.mul_add_f32s(simd.splat_f32s(*z), *row, sz);
            }
            (x[i], y[i], z[i]) = (sx, sy, sz);
        }
    }
}

/// `x += by (a shape_a + b shape_b)`, per coordinate.
pub(crate) struct Yield<'a> {
    pub shapes: [&'a [f32]; 2],
    pub weights: [f32; 2],
    pub by: [f32; 3],
    pub x: &'a mut [f32],
}

impl WithSimd for Yield<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let [a, b] = self.shapes.map(|s| vectors::<S>(s));
        let [wa, wb] = self.weights.map(|w| simd.splat_f32s(w));
        let [bx, by, bz] = self.by.map(|b| simd.splat_f32s(b));
        let x = vectors_mut::<S>(self.x);
        let k = a.len();
        for i in 0..k {
            let shape = simd.mul_add_f32s(wa, a[i], simd.mul_f32s(wb, b[i]));
            x[i] = simd.mul_add_f32s(bx, shape, x[i]);
            x[k + i] = simd.mul_add_f32s(by, shape, x[k + i]);
            x[2 * k + i] = simd.mul_add_f32s(bz, shape, x[2 * k + i]);
        }
    }
}

/// `d = x - skin`, `velocity = (d - offset) / h` held within bounds, `offset = d`.
pub(crate) struct Settle<'a> {
    pub x: &'a [f32],
    pub skin: &'a [f32],
    pub inv_h: f32,
    pub max_speed: f32,
    pub offset: &'a mut [f32],
    pub velocity: &'a mut [f32],
}

impl WithSimd for Settle<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (x, skin) = (vectors::<S>(self.x), vectors::<S>(self.skin));
        let (offset, velocity) = (vectors_mut::<S>(self.offset), vectors_mut::<S>(self.velocity));
        let inv_h = simd.splat_f32s(self.inv_h);
        let (most, least) = (simd.splat_f32s(self.max_speed), simd.splat_f32s(-self.max_speed));
        for (((x, s), d), v) in x.iter().zip(skin).zip(offset).zip(velocity) {
            let now = simd.sub_f32s(*x, *s);
            let speed = simd.mul_f32s(simd.sub_f32s(now, *d), inv_h);
            *v = simd.min_f32s(simd.max_f32s(speed, least), most);
            *d = now;
        }
    }
}

/// Length of the longest of `pad` vectors kept as three arrays.
pub(crate) struct Longest<'a> {
    pub values: &'a [f32],
    pub pad: usize,
}

impl WithSimd for Longest<'_> {
    type Output = f32;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f32 {
        let k = self.pad / S::F32_LANES;
        let v = vectors::<S>(self.values);
        let mut most = simd.splat_f32s(0.0);
        for i in 0..k {
            let (x, y, z) = (v[i], v[k + i], v[2 * k + i]);
            let length2 = simd.mul_add_f32s(x, x, simd.mul_add_f32s(y, y, simd.mul_f32s(z, z)));
            most = simd.max_f32s(most, length2);
        }
        simd.reduce_max_f32s(most).sqrt()
    }
}

/// Whether every value is finite.
pub(crate) struct Sound<'a>(pub &'a [f32]);

impl WithSimd for Sound<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let zero = simd.splat_f32s(0.0);
        let mut sum = zero;
        for v in vectors::<S>(self.0) {
            // Zero unless the value is none or without bound.
            sum = simd.mul_add_f32s(*v, zero, sum);
        }
        simd.reduce_sum_f32s(sum) == 0.0
    }
}
