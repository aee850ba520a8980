//! The skinning transform both sides of the model file agree on: B_g(i) of AS16 Eq. (5), from positions alone.
//!
//! AS16 asks only that B_g(i) take particle i of guide g from its rest state to its current one. Two readings are kept. One
//! translates. The other is rigid: a rotation carried from the root to the tip without twist, so that neighbouring particles
//! turn a hair the same way, and the translation that puts the guide's own particle where it is. Kept as what it adds to
//! the rest position, either is exactly zero for a guide at rest. Weights are trained for this transform; a runtime that used another
//! one would blend something the weights were not made for, hence one home for both.

/// Squared length of the sum of two unit vectors below which they count as opposite.
const OPPOSITE: f64 = 1e-12;

/// How a guide moves the hairs that depend on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Blend {
    /// Each particle only moves what is near it. Measured the better of the two (docs/DEVIATIONS.md): a guide that turns
    /// its neighbours about itself draws apart hairs whose roots stay side by side.
    Translation,
    /// Each particle turns and moves what is near it.
    Rigid,
}

type Matrix = [[f64; 3]; 3];

/// A rigid transform of the head frame, as what it adds to a rest position `x`: `linear * x + offset`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DisplacementTransform {
    /// Rotation minus identity, by rows.
    pub linear: [[f32; 3]; 3],
    /// Translation (cm).
    pub offset: [f32; 3],
}

impl DisplacementTransform {
    /// Where the transform puts the point whose rest position is `rest` (cm, head frame).
    #[must_use]
    pub fn apply(&self, rest: [f32; 3]) -> [f32; 3] {
        let mut out = [0.0; 3];
        for r in 0..3 {
            let l = self.linear[r];
            out[r] = rest[r] + (l[0] * rest[0] + l[1] * rest[1] + l[2] * rest[2] + self.offset[r]);
        }
        out
    }
}

/// Transforms of all particles of one guide, from its `rest` and `current` particles (cm, head frame, root first) to `out`.
/// Home of the B_g(i) of AS16 Eq. (5). If rigid, rotation i takes the rest direction of segment i (at the tip, of the last segment)
/// to its current one, by the least turn after rotation i - 1; at the root, by the least turn.
/// The root's turn about its own direction is thus lost: roots are held by the scalp, whose turn the head frame carries.
/// Where a segment has no length, at rest or now, the rotation before it is kept. Computed in `f64`.
///
/// # Panics
/// If the three slices differ in length.
pub fn guide_transforms(rest: &[[f32; 3]], current: &[[f32; 3]], blend: Blend, out: &mut [DisplacementTransform]) {
    let n = rest.len();
    assert!(current.len() == n && out.len() == n, "rest, current and out must have one entry per particle");
    // Rotation minus identity: small turns keep their precision, and no turn is exactly zero.
    let mut turn = [[0.0; 3]; 3];
    for i in 0..n {
        if blend == Blend::Rigid
            && i + 1 < n
            && let (Some(a), Some(b)) = (direction(rest, i), direction(current, i))
        {
            let carried = add(a, times(&turn, a));
            turn = compose(&least_turn(carried, b), &turn);
        }
        let (p_rest, p) = (widen(rest[i]), widen(current[i]));
        let rotated = times(&turn, p_rest);
        out[i] = DisplacementTransform {
            linear: turn.map(|row| row.map(|x| x as f32)),
            offset: [0, 1, 2].map(|c| (p[c] - p_rest[c] - rotated[c]) as f32),
        };
    }
}

/// Unit vector along segment `i`, unless it has no length.
fn direction(points: &[[f32; 3]], i: usize) -> Option<[f64; 3]> {
    let (a, b) = (widen(points[i]), widen(points[i + 1]));
    let d = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
    let length = dot(d, d).sqrt();
    (length > 0.0 && length.is_finite()).then(|| d.map(|x| x / length))
}

/// The least rotation taking unit vector `a` to unit vector `b`, minus identity; zero when they are equal.
fn least_turn(a: [f64; 3], b: [f64; 3]) -> Matrix {
    if a == b {
        return [[0.0; 3]; 3];
    }
    let sum = add(a, b);
    // 1 + cos of the angle, without its cancellation near opposite vectors.
    let one_plus_cos = 0.5 * dot(sum, sum);
    if 2.0 * one_plus_cos < OPPOSITE {
        return half_turn(a);
    }
    let v = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let cross = [[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]];
    let squared = dot(v, v);
    // Rodrigues: [v]x + [v]x^2 / (1 + cos), where [v]x^2 = v v^T - |v|^2 I.
    let mut turn = cross;
    for r in 0..3 {
        for c in 0..3 {
            let identity = if r == c { squared } else { 0.0 };
            turn[r][c] += (v[r] * v[c] - identity) / one_plus_cos;
        }
    }
    turn
}

/// Half a turn about some axis across unit vector `a`, minus identity: all least turns to the opposite are equal in size.
fn half_turn(a: [f64; 3]) -> Matrix {
    let smallest = if a[0].abs() <= a[1].abs() && a[0].abs() <= a[2].abs() {
        0
    } else if a[1].abs() <= a[2].abs() {
        1
    } else {
        2
    };
    let mut axis = a.map(|x| -x * a[smallest]);
    axis[smallest] += 1.0;
    let squared = dot(axis, axis);
    let mut turn = [[0.0; 3]; 3];
    for r in 0..3 {
        for c in 0..3 {
            turn[r][c] = 2.0 * axis[r] * axis[c] / squared - if r == c { 2.0 } else { 0.0 };
        }
    }
    turn
}

/// `after * before` of two rotations, each given and returned minus identity.
fn compose(after: &Matrix, before: &Matrix) -> Matrix {
    let mut turn = [[0.0; 3]; 3];
    for r in 0..3 {
        for c in 0..3 {
            let product: f64 = (0..3).map(|k| after[r][k] * before[k][c]).sum();
            turn[r][c] = after[r][c] + before[r][c] + product;
        }
    }
    turn
}

fn widen(p: [f32; 3]) -> [f64; 3] {
    p.map(f64::from)
}

fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn times(m: &Matrix, v: [f64; 3]) -> [f64; 3] {
    [dot(m[0], v), dot(m[1], v), dot(m[2], v)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rotations are stored in `f32`.
    const ORTHONORMAL: f64 = 1e-6;
    /// Round-off of `f32` positions some 30 cm from the origin, after a rotation and a sum.
    const ROUND_OFF_CM: f32 = 2e-5;

    fn curl(n: usize, phase: f32) -> Vec<[f32; 3]> {
        (0..n)
            .map(|i| {
                let s = i as f32 * 0.5;
                [3.0 + (s + phase).cos(), 10.0 - s, -2.0 + (s + phase).sin() + 0.1 * phase * s]
            })
            .collect()
    }

    fn transforms(rest: &[[f32; 3]], current: &[[f32; 3]]) -> Vec<DisplacementTransform> {
        let mut out = vec![DisplacementTransform::default(); rest.len()];
        guide_transforms(rest, current, Blend::Rigid, &mut out);
        out
    }

    fn assert_rotations(transforms: &[DisplacementTransform]) {
        for t in transforms {
            let mut r = t.linear.map(|row| row.map(f64::from));
            for (k, row) in r.iter_mut().enumerate() {
                row[k] += 1.0;
            }
            for a in 0..3 {
                for b in 0..3 {
                    let expected = if a == b { 1.0 } else { 0.0 };
                    assert!((dot(r[a], r[b]) - expected).abs() < ORTHONORMAL, "{r:?}");
                }
            }
            let v = [
                r[1][1] * r[2][2] - r[1][2] * r[2][1],
                r[1][2] * r[2][0] - r[1][0] * r[2][2],
                r[1][0] * r[2][1] - r[1][1] * r[2][0],
            ];
            assert!(dot(r[0], v) > 0.0, "a mirror, not a rotation: {r:?}");
        }
    }

    #[test]
    fn a_guide_at_rest_has_exactly_no_transform() {
        let rest = curl(25, 0.3);
        for t in transforms(&rest, &rest) {
            assert_eq!(t, DisplacementTransform::default());
            let p = [7.123_456, -3.3, 1e-3];
            assert_eq!(t.apply(p), p);
        }
    }

    #[test]
    fn every_guide_particle_is_put_where_it_is() {
        let (rest, current) = (curl(25, 0.0), curl(25, 2.0));
        let out = transforms(&rest, &current);
        assert_rotations(&out);
        for i in 0..rest.len() {
            let p = out[i].apply(rest[i]);
            for c in 0..3 {
                assert!((p[c] - current[i][c]).abs() < ROUND_OFF_CM, "particle {i}: {p:?}, not {:?}", current[i]);
            }
        }
    }

    #[test]
    fn a_guide_turned_across_its_root_direction_carries_nearby_points_rigidly() {
        let rest = curl(25, 0.7);
        let root = widen(rest[0]);
        let along = direction(&rest, 0).expect("the first segment has a length");
        // Any turn about an axis across the root's direction: the one kind that positions alone determine at the root.
        let target = {
            let across = half_turn(along).map(|row| row.map(|x| x * 0.3));
            let tilted = add(along, times(&across, [0.3, -0.8, 0.5]));
            let length = dot(tilted, tilted).sqrt();
            tilted.map(|x| x / length)
        };
        let turn = least_turn(along, target);
        let moved = |p: [f32; 3]| -> [f32; 3] {
            let d = [0, 1, 2].map(|c| f64::from(p[c]) - root[c]);
            let r = add(d, times(&turn, d));
            [0, 1, 2].map(|c| (root[c] + r[c] + [0.4, -0.2, 1.0][c]) as f32)
        };
        let current: Vec<_> = rest.iter().map(|&p| moved(p)).collect();
        let out = transforms(&rest, &current);
        assert_rotations(&out);
        for i in 0..rest.len() {
            let near = [rest[i][0] + 0.7, rest[i][1] - 0.2, rest[i][2] + 1.1];
            let (p, expected) = (out[i].apply(near), moved(near));
            for c in 0..3 {
                assert!((p[c] - expected[c]).abs() < ROUND_OFF_CM, "particle {i}: {p:?}, not {expected:?}");
            }
        }
    }

    #[test]
    fn a_segment_without_length_keeps_the_rotation_before_it() {
        let rest = curl(6, 0.0);
        let mut current = curl(6, 1.0);
        current[3] = current[2];
        let out = transforms(&rest, &current);
        assert_rotations(&out);
        assert_eq!(out[2].linear, out[1].linear);
        let mut folded = rest.clone();
        folded[1] = folded[0];
        assert_eq!(transforms(&folded, &rest)[0].linear, [[0.0; 3]; 3]);
    }

    #[test]
    fn a_strand_turned_back_on_itself_still_gets_rotations() {
        let rest: Vec<[f32; 3]> = (0..5).map(|i| [0.0, i as f32, 0.0]).collect();
        let current: Vec<[f32; 3]> = (0..5).map(|i| [0.0, -(i as f32), 0.0]).collect();
        let nearly: Vec<[f32; 3]> = (0..5).map(|i| [i as f32 * 1e-5, -(i as f32), 0.0]).collect();
        for current in [current, nearly] {
            let out = transforms(&rest, &current);
            assert_rotations(&out);
            let tip = out[4].apply(rest[4]);
            assert!((tip[1] - current[4][1]).abs() < ROUND_OFF_CM, "{tip:?}");
        }
    }
}
