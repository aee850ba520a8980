//! Eight triangles side by side: their distances from points, and the solid angles they are seen under.

use nalgebra::Vector3;

use super::Corners;
use crate::lanes::{F8, LANES, dot};

/// Eight triangles prepared for distances: the corner across from the longest edge, the edges from there, and the vectors
/// whose products with a point's place give its place on the triangle. Made in double precision, so that needles are
/// as exact as any other.
#[derive(Debug, Clone)]
pub(super) struct Leaf {
    a: [F8; 3],
    ab: [F8; 3],
    ac: [F8; 3],
    /// Share of the way along each edge, by product with a place from `a`; zero for what has no area.
    along_ab: [F8; 3],
    along_ac: [F8; 3],
    normal: [F8; 3],
    /// |ab|² - ab·ac, then one over |ab|², |ac|², |bc|²; zero for what has no length.
    to_bc: F8,
    inv_ab: F8,
    inv_ac: F8,
    inv_bc: F8,
    /// Triangles it holds; the first fills the lanes left over.
    pub count: usize,
}

// Written out: a closure handed to `map` is compiled without the vector instructions of its caller.

#[inline(always)]
pub(super) fn minus(a: &[F8; 3], b: &[F8; 3]) -> [F8; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
fn along(from: &[F8; 3], s: F8, e: &[F8; 3]) -> [F8; 3] {
    [from[0] - s * e[0], from[1] - s * e[1], from[2] - s * e[2]]
}

#[inline(always)]
fn wide(x: f32) -> f64 {
    f64::from(x)
}

#[inline(always)]
fn product(u: [f64; 3], v: [f64; 3]) -> f64 {
    u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
}

#[inline(always)]
pub(super) fn norm2(r: &[F8; 3]) -> F8 {
    dot(*r, *r)
}

impl Leaf {
    pub fn new(triangles: impl ExactSizeIterator<Item = Corners>) -> Self {
        let count = triangles.len();
        let (zero, none) = (F8::ZERO, [F8::ZERO; 3]);
        let mut leaf = Self {
            a: none,
            ab: none,
            ac: none,
            along_ab: none,
            along_ac: none,
            normal: none,
            to_bc: zero,
            inv_ab: zero,
            inv_ac: zero,
            inv_bc: zero,
            count,
        };
        let inverse = |x: f64| if x > f64::from(f32::MIN_POSITIVE) { 1.0 / x } else { 0.0 };
        let triangles: Vec<Corners> = triangles.collect();
        for lane in 0..LANES {
            let mut corners = triangles[if lane < count { lane } else { 0 }];
            let across = |c: &Corners, n: usize| (c[(n + 1) % 3] - c[(n + 2) % 3]).norm_squared();
            let first = (0..3).max_by(|&m, &n| across(&corners, m).total_cmp(&across(&corners, n))).unwrap_or(0);
            corners.rotate_left(first);
            let [a, b, c] = corners.map(|c| c.cast::<f64>());
            let (ab, ac) = (b - a, c - a);
            let area = ab.cross(&ac);
            let inv_area2 = inverse(area.norm_squared());
            let set = |to: &mut [F8; 3], v: Vector3<f64>| {
                for k in 0..3 {
                    to[k].0[lane] = v[k] as f32;
                }
            };
            set(&mut leaf.a, a);
            set(&mut leaf.ab, ab);
            set(&mut leaf.ac, ac);
            set(&mut leaf.along_ab, ac.cross(&area) * inv_area2);
            set(&mut leaf.along_ac, area.cross(&ab) * inv_area2);
            set(&mut leaf.normal, area * inv_area2.sqrt());
            leaf.to_bc.0[lane] = (ab.norm_squared() - ab.dot(&ac)) as f32;
            leaf.inv_ab.0[lane] = inverse(ab.norm_squared()) as f32;
            leaf.inv_ac.0[lane] = inverse(ac.norm_squared()) as f32;
            leaf.inv_bc.0[lane] = inverse((c - b).norm_squared()) as f32;
            if inv_area2 == 0.0 {
                // On no face: the share along an edge is never within it.
                leaf.along_ab[0].0[lane] = f32::NAN;
            }
        }
        leaf
    }

    /// All that depends on the triangle.
    pub fn numbers(&self) -> [&F8; 22] {
        let Self { a: [a, b, c], ab: [d, e, f], ac: [g, h, i], along_ab: [j, k, l], along_ac: [m, n, o], .. } = self;
        let Self { normal: [p, q, r], to_bc, inv_ab, inv_ac, inv_bc, .. } = self;
        [a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p, q, r, to_bc, inv_ab, inv_ac, inv_bc]
    }

    pub fn numbers_mut(&mut self) -> [&mut F8; 22] {
        let Self {
            a: [a, b, c],
            ab: [d, e, f],
            ac: [g, h, i],
            along_ab: [j, k, l],
            along_ac: [m, n, o],
            normal: [p, q, r],
            to_bc,
            inv_ab,
            inv_ac,
            inv_bc,
            ..
        } = self;
        [a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p, q, r, to_bc, inv_ab, inv_ac, inv_bc]
    }

    /// Squared distances of a point to the triangles: the least over three edges, and the face where the foot is on it.
    #[inline(always)]
    pub fn distance2(&self, p: &[F8; 3]) -> F8 {
        let (ab, ac) = (&self.ab, &self.ac);
        let ap = minus(p, &self.a);
        let (d1, d2) = (dot(*ab, ap), dot(*ac, ap));
        let (s, t) = (dot(self.along_ab, ap), dot(self.along_ac, ap));
        // The foot is on the face where s, t and the rest are none negative; elsewhere the face is given up.
        let inner = s.least(t).least(F8::splat(1.0) - s - t);
        let off_face = inner.zip(inner, |x, _| if x >= 0.0 { 0.0 } else { f32::INFINITY });
        let u = ((d2 - d1 + self.to_bc) * self.inv_bc).clamp01();
        let on_ab = norm2(&along(&ap, (d1 * self.inv_ab).clamp01(), ab));
        let on_ac = norm2(&along(&ap, (d2 * self.inv_ac).clamp01(), ac));
        let on_bc = norm2(&along(&along(&ap, F8::splat(1.0) - u, ab), u, ac));
        let height = dot(self.normal, ap);
        let on_face = height * height;
        (on_face + off_face).least(on_ab.least(on_ac).least(on_bc))
    }

    /// Share of the full solid angle under which `q` sees the triangles, positive from behind. In double precision: beside
    /// an edge the denominator is what is left of three products of lengths that cancel.
    #[inline(always)]
    pub fn winding(&self, q: &[f32; 3]) -> f32 {
        let mut sine = [0.0f64; LANES];
        let mut cosine = [0.0f64; LANES];
        for l in 0..LANES {
            // Written out, see above.
            let (ab, ac) = (&self.ab, &self.ac);
            let ab = [wide(ab[0].0[l]), wide(ab[1].0[l]), wide(ab[2].0[l])];
            let ac = [wide(ac[0].0[l]), wide(ac[1].0[l]), wide(ac[2].0[l])];
            let a = &self.a;
            let a = [wide(a[0].0[l] - q[0]), wide(a[1].0[l] - q[1]), wide(a[2].0[l] - q[2])];
            let (b, c) = ([a[0] + ab[0], a[1] + ab[1], a[2] + ab[2]], [a[0] + ac[0], a[1] + ac[1], a[2] + ac[2]]);
            let (la, lb, lc) = (product(a, a).sqrt(), product(b, b).sqrt(), product(c, c).sqrt());
            let b_x_c = [b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]];
            sine[l] = product(a, b_x_c);
            cosine[l] = la * lb * lc + product(a, b) * lc + product(b, c) * la + product(c, a) * lb;
        }
        let turns = turns(&sine, &cosine);
        let mut sum = 0.0;
        for l in 0..LANES {
            sum += if l < self.count { turns.0[l] } else { 0.0 };
        }
        sum
    }

    /// As [`Self::winding`], one triangle at a time and with the library's angle: what it is compared with.
    #[cfg(test)]
    pub fn winding_plainly(&self, q: &[f32; 3]) -> f64 {
        let mut sum = 0.0;
        for l in 0..self.count {
            let vector = |v: &[F8; 3]| Vector3::new(v[0].0[l], v[1].0[l], v[2].0[l]);
            let a = (vector(&self.a) - Vector3::from(*q)).cast::<f64>();
            let (b, c) = (a + vector(&self.ab).cast(), a + vector(&self.ac).cast());
            let [la, lb, lc] = [a.norm(), b.norm(), c.norm()];
            let volume = a.dot(&b.cross(&c));
            let denominator = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
            sum += if volume == 0.0 { 0.0 } else { volume.atan2(denominator) };
        }
        sum / std::f64::consts::TAU
    }
}

/// Angles of (cosine, sine) in turns, from minus a half to a half; zero where the sine is. Errs by a few millionths: a sum of some
/// hundreds is told from its neighbouring integers.
#[inline(always)]
fn turns(sine: &[f64; LANES], cosine: &[f64; LANES]) -> F8 {
    let mut out = F8::ZERO;
    for l in 0..LANES {
        let (y, x) = (sine[l].abs(), cosine[l].abs());
        let (less, more) = if y < x { (y, x) } else { (x, y) };
        let t = if more > 0.0 { (less / more) as f32 } else { 0.0 };
        // The arctangent up to one (Abramowitz and Stegun 1964, 4.4.48), which errs by a hundred-thousandth.
        let t2 = t * t;
        let series = 0.180_141 + t2 * (-0.085_133 + t2 * 0.020_835_1);
        let up_to_eighth = t * (0.999_866 + t2 * (-0.330_299_5 + t2 * series)) * (1.0 / std::f32::consts::TAU);
        let up_to_quarter = if y < x { up_to_eighth } else { 0.25 - up_to_eighth };
        let up_to_half = if cosine[l] < 0.0 { 0.5 - up_to_quarter } else { up_to_quarter };
        let signed = if sine[l] < 0.0 { -up_to_half } else { up_to_half };
        out.0[l] = if y > 0.0 { signed } else { 0.0 };
    }
    out
}
