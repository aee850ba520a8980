//! Altitude springs of a tetrahedron (MS08 §3.1, Fig. 3, Appendix): one spring between two virtual nodes that keeps four
//! particles from collapsing to a plane and turns them right side out again.
//!
//! With S_p the gradient of six times the signed volume D by particle p, all seven candidates have one form: c is S_p for
//! the point p over its face, and the sum of two S for a pair of opposite edges. The spring has direction c/|c|, signed
//! length D/|c|, and weights w_p = S_p·c/|c|² on the particles: the exact gradient of its length is w_p c/|c|, so it is
//! rank one, exerts neither force nor torque on the whole, and one volume serves all candidates. The least length is
//! the largest |c|. Lengths carry the sign of the volume, at rest as in motion: without it inversion is never undone.

use crate::lanes::{self, LANES, Lane, Lane3, ZERO};
use nalgebra::Vector3;

/// Candidates of a tetrahedron: a point over its face for particles 0 to 3, then the edges 01|23, 02|13, 03|12.
pub const CANDIDATES: usize = 7;

/// Factor on an edge/edge candidate's |u×v|² when the rest shape chooses. Departure from MS08, where it is one: in the
/// straight rig at rest a point/face and an edge/edge spring tie exactly, round-off would pick between them all along the
/// hair, and they differ by 1.7 in EI and 2.5 in GJ.
pub const EDGE_PREFERENCE: f64 = 1.1;

/// Smallest length a spring constant is divided by, as a share of the tetrahedron's size (root mean square of its six
/// rest edges). Departure from MS08: a flat rest shape has l0 = 0 and k/l0 is infinite. Only the divisor is floored, not
/// the length aimed at, so a flat rest shape stays free of stress.
pub const FLOOR: f64 = 0.1;

/// Squared sine below which four particles count as collinear; the direction's round-off is then still below 1e-9.
const COLLINEAR_SINE_SQUARED: f64 = 1e-10;

/// Edges shorter than this share of the longest have collapsed: their own springs restore them (MS08 §3.1).
const COLLAPSED: f64 = 1e-5;

/// Longest edge divided by, as a share of the rest size: below it the whole tetrahedron is a point.
const POINT: f64 = 1e-6;

/// How much larger |u×v|² another candidate needs to take the place of the one that is least at rest. Departure from MS08 §3.1,
/// which takes the least length outright: by symmetry several candidates of a hair's tetrahedra tie at rest, and where
/// they tie under load the force jumps, so that hanging hair never comes to rest (docs/DEVIATIONS.md). What this costs is
/// a weight a little below zero, no less than 1 - √1.5 = -0.22, before the change: forces stay bounded.
pub const PREFERENCE: f64 = 1.5;

/// Opposite edges of the three edge/edge candidates: the virtual node on the second pair is the positive one.
const PAIRS: [[usize; 4]; 3] = [[0, 1, 2, 3], [0, 2, 1, 3], [0, 3, 1, 2]];

/// Rest lengths of a tetrahedron's seven candidates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AltitudeRest {
    /// Signed lengths at rest, cm, in the order of the candidates; zero where the rest shape is flat.
    pub length: [f64; CANDIDATES],
    /// Least length that a spring constant is divided by, cm: [`FLOOR`] times the size.
    pub floor: f64,
    /// The candidate of least length at rest: kept until another is clearly shorter.
    pub preferred: usize,
}

/// The rest lengths of one tetrahedron in every strand of a batch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AltitudeRestLanes {
    /// As [`AltitudeRest::length`].
    pub length: [Lane; CANDIDATES],
    /// As [`AltitudeRest::floor`].
    pub floor: Lane,
    /// As [`AltitudeRest::preferred`], as a number.
    pub preferred: Lane,
}

/// The altitude spring in force: F_p = -k·per_length·(length - rest_length)·`weight[p]`·direction, and
/// (h·b + h²·k·per_length)(w⊗d)(w⊗d)ᵀ in the implicit matrix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Altitude {
    /// Share of the force that each particle takes; they sum to zero, and length = d·Σ w_p x_p.
    pub weight: [f64; 4],
    /// Unit direction from the negative virtual node to the positive one when the volume is positive.
    pub direction: Vector3<f64>,
    /// Present length, cm, negative where the volume is.
    pub length: f64,
    /// Length at rest, cm, negative where the rest volume is.
    pub rest_length: f64,
    /// Reciprocal of the rest length's size, floored, 1/cm.
    pub per_length: f64,
    /// Which candidate: below four the particle over its face, else the pair of edges.
    pub candidate: usize,
}

/// [`Altitude`] in every lane. Where there is no spring, weights and `per_length` are zero, so it adds nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AltitudeLanes {
    /// As [`Altitude::weight`].
    pub weight: [Lane; 4],
    /// As [`Altitude::direction`].
    pub direction: Lane3,
    /// As [`Altitude::length`], cm.
    pub length: Lane,
    /// As [`Altitude::rest_length`], cm.
    pub rest_length: Lane,
    /// As [`Altitude::per_length`], 1/cm.
    pub per_length: Lane,
}

impl AltitudeRest {
    /// Rest lengths of a tetrahedron with corners `x`, cm. A candidate without area, as in collinear particles, has rest
    /// length zero, like a flat shape.
    #[must_use]
    pub fn new(x: &[Vector3<f64>; 4]) -> Self {
        let shape = Shape::new(x);
        let squares: f64 = edges(x).iter().map(|e| e.norm_squared()).sum();
        let size = (squares / 6.0).sqrt();
        let no_area = COLLINEAR_SINE_SQUARED.sqrt() * size * size;
        let length = shape.candidates().map(|c| {
            let area = c.norm();
            if area > no_area { shape.six_volumes / area } else { 0.0 }
        });
        let areas = shape.candidates().map(|c| c.norm_squared());
        let score = |i: usize| if i < 4 { areas[i] } else { EDGE_PREFERENCE * areas[i] };
        let preferred = (1..CANDIDATES).fold(0, |best, i| if score(i) > score(best) { i } else { best });
        Self { length, floor: FLOOR * size, preferred }
    }

    /// The same rest lengths in every lane.
    #[must_use]
    pub fn splat(&self) -> AltitudeRestLanes {
        AltitudeRestLanes {
            length: self.length.map(|v| [v; LANES]),
            floor: [self.floor; LANES],
            preferred: [self.preferred as f64; LANES],
        }
    }
}

impl AltitudeRestLanes {
    /// Puts the rest lengths of one strand into its lane.
    pub fn set(&mut self, lane: usize, rest: &AltitudeRest) {
        for (to, from) in self.length.iter_mut().zip(rest.length) {
            to[lane] = from;
        }
        self.floor[lane] = rest.floor;
        self.preferred[lane] = rest.preferred as f64;
    }

    /// The rest lengths in one lane.
    #[must_use]
    pub fn get(&self, lane: usize) -> AltitudeRest {
        AltitudeRest {
            length: self.length.map(|v| v[lane]),
            floor: self.floor[lane],
            preferred: self.preferred[lane] as usize,
        }
    }
}

/// Six times the signed volume and its gradient by each corner.
struct Shape {
    six_volumes: f64,
    gradient: [Vector3<f64>; 4],
}

impl Shape {
    fn new(x: &[Vector3<f64>; 4]) -> Self {
        let [a, b, c] = [x[1] - x[0], x[2] - x[0], x[3] - x[0]];
        let gradient = [b.cross(&c), c.cross(&a), a.cross(&b)];
        let six_volumes = a.dot(&gradient[0]);
        let first = -(gradient[0] + gradient[1] + gradient[2]);
        Self { six_volumes, gradient: [first, gradient[0], gradient[1], gradient[2]] }
    }

    /// c of every candidate; its norm is |u×v|, u and v edges of the face or the opposite edges.
    fn candidates(&self) -> [Vector3<f64>; CANDIDATES] {
        let [s0, s1, s2, s3] = self.gradient;
        [s0, s1, s2, s3, s2 + s3, s1 + s3, s1 + s2]
    }
}

fn edges(x: &[Vector3<f64>; 4]) -> [Vector3<f64>; 6] {
    [x[1] - x[0], x[2] - x[0], x[3] - x[0], x[2] - x[1], x[3] - x[1], x[3] - x[2]]
}

/// The altitude spring of the tetrahedron with corners `x` (cm), or none where an edge has collapsed.
/// Implements MS08 §3.1: of four point/face and three edge/edge springs the one of least length, largest |u×v|,
/// that of the rest shape preferred by [`PREFERENCE`].
///
/// Force jumps where the choice changes, but for one place: at rest it is zero for either.
#[must_use]
pub fn altitude(x: &[Vector3<f64>; 4], rest: &AltitudeRest) -> Option<Altitude> {
    let shape = Shape::new(x);
    let mut candidate = 0;
    let candidates = shape.candidates();
    let prefer = |i: usize| if i == rest.preferred { PREFERENCE } else { 1.0 };
    let mut largest = prefer(0) * candidates[0].norm_squared();
    for (i, c) in candidates.iter().enumerate().skip(1) {
        let other = prefer(i) * c.norm_squared();
        if other > largest {
            (candidate, largest) = (i, other);
        }
    }
    let area_squared = candidates[candidate].norm_squared();
    let longest_squared =
        (x[1] - x[0]).norm_squared().max((x[2] - x[0]).norm_squared()).max((x[3] - x[0]).norm_squared());
    // Every edge is at most twice the longest at corner 0: passing this, the chosen u and v pass MS08's two tests.
    if !is_solid(area_squared, longest_squared, rest.floor) {
        return collinear(x, rest);
    }
    let inv_area = 1.0 / area_squared.sqrt();
    let direction = candidates[candidate] * inv_area;
    let rest_length = rest.length[candidate];
    Some(Altitude {
        weight: shape.gradient.map(|s| s.dot(&direction) * inv_area),
        direction,
        length: shape.six_volumes * inv_area,
        rest_length,
        per_length: 1.0 / rest_length.abs().max(rest.floor),
        candidate,
    })
}

/// Whether the largest |u×v| is a sound direction. False for anything not finite.
#[inline(always)]
fn is_solid(area_squared: f64, longest_squared: f64, floor: f64) -> bool {
    const POINT_SQUARED: f64 = (POINT / FLOOR) * (POINT / FLOOR);
    (longest_squared > POINT_SQUARED * floor * floor)
        & (area_squared > COLLINEAR_SINE_SQUARED * longest_squared * longest_squared)
        & (area_squared < f64::INFINITY)
}

/// The degenerate case of MS08 §3.1: four particles on a line, no two of them at one place, get the edge/edge spring
/// whose edges overlap most, its nodes in the middle of the overlap and its direction square to the line.
#[cold]
#[inline(never)]
fn collinear(x: &[Vector3<f64>; 4], rest: &AltitudeRest) -> Option<Altitude> {
    let mut longest = Vector3::zeros();
    let mut shortest_squared = f64::INFINITY;
    for edge in edges(x) {
        let square = edge.norm_squared();
        if !square.is_finite() {
            return None;
        }
        shortest_squared = shortest_squared.min(square);
        if square > longest.norm_squared() {
            longest = edge;
        }
    }
    let length = longest.norm();
    if length <= POINT / FLOOR * rest.floor || shortest_squared <= (COLLAPSED * length).powi(2) {
        return None;
    }
    let along = longest / length;
    let place = x.map(|p| (p - x[0]).dot(&along));
    let mut best = (0.0, 0, 0.0);
    for (pair, [a, b, c, d]) in PAIRS.into_iter().enumerate() {
        let low = place[a].min(place[b]).max(place[c].min(place[d]));
        let high = place[a].max(place[b]).min(place[c].max(place[d]));
        if high - low > best.0 {
            best = (high - low, pair, (low + high) / 2.0);
        }
    }
    let (overlap, pair, middle) = best;
    if overlap <= 0.0 {
        return None;
    }
    let [a, b, c, d] = PAIRS[pair];
    let s = (middle - place[a]) / (place[b] - place[a]);
    let t = (middle - place[c]) / (place[d] - place[c]);
    let mut weight = [0.0; 4];
    (weight[a], weight[b], weight[c], weight[d]) = (s - 1.0, -s, 1.0 - t, t);
    let axis = if along.x.abs() < 0.6 { Vector3::x() } else { Vector3::z() };
    let rest_length = rest.length[4 + pair];
    Some(Altitude {
        weight,
        direction: along.cross(&axis).normalize(),
        length: 0.0,
        rest_length,
        per_length: 1.0 / rest_length.abs().max(rest.floor),
        candidate: 4 + pair,
    })
}

/// [`altitude`] of one tetrahedron in every lane: `x[p]` holds corner p of each strand's, cm.
///
/// The choice is by comparison and selection, one root and two divisions a lane; collinear lanes leave the fast path
/// one by one. A lane's result does not depend on the others.
#[inline(always)]
#[must_use]
pub fn altitude_lanes(x: [&Lane3; 4], rest: &AltitudeRestLanes) -> AltitudeLanes {
    let mut out =
        AltitudeLanes { weight: [ZERO; 4], direction: [ZERO; 3], length: ZERO, rest_length: ZERO, per_length: ZERO };
    let mut all_solid = true;
    let mut solid = [false; LANES];
    for l in 0..LANES {
        let o = [x[0][0][l], x[0][1][l], x[0][2][l]];
        let a = [x[1][0][l] - o[0], x[1][1][l] - o[1], x[1][2][l] - o[2]];
        let b = [x[2][0][l] - o[0], x[2][1][l] - o[1], x[2][2][l] - o[2]];
        let c = [x[3][0][l] - o[0], x[3][1][l] - o[1], x[3][2][l] - o[2]];
        let (s1, s2, s3) = (cross(b, c), cross(c, a), cross(a, b));
        let s23 = add(s2, s3);
        let s0 = add(s1, s23);
        let mut best = s0;
        // s0 is minus the sum of the others; its sign is put right once, on the choice.
        let mut sign = -1.0;
        let preferred = rest.preferred[l];
        let mut largest = dot(s0, s0) * if preferred == 0.0 { PREFERENCE } else { 1.0 };
        let mut rest_length = rest.length[0][l];
        macro_rules! consider {
            ($candidate:expr, $i:expr) => {
                let candidate = $candidate;
                let square = dot(candidate, candidate) * if preferred == f64::from($i) { PREFERENCE } else { 1.0 };
                let take = square > largest;
                for k in 0..3 {
                    best[k] = if take { candidate[k] } else { best[k] };
                }
                sign = if take { 1.0 } else { sign };
                largest = if take { square } else { largest };
                rest_length = if take { rest.length[$i as usize][l] } else { rest_length };
            };
        }
        consider!(s1, 1);
        consider!(s2, 2);
        consider!(s3, 3);
        consider!(s23, 4);
        consider!(add(s1, s3), 5);
        consider!(add(s1, s2), 6);
        let _ = largest;
        let area_squared = dot(best, best);
        let longest_squared = dot(a, a).max(dot(b, b)).max(dot(c, c));
        solid[l] = is_solid(area_squared, longest_squared, rest.floor[l]);
        all_solid &= solid[l];
        let inv_area = sign * lanes::inv_sqrt_of(area_squared);
        let d = [best[0] * inv_area, best[1] * inv_area, best[2] * inv_area];
        // 1/|c| is inv_area without the sign.
        let scale = inv_area * sign;
        let (w1, w2, w3) = (dot(s1, d) * scale, dot(s2, d) * scale, dot(s3, d) * scale);
        out.weight[0][l] = -(w1 + w2 + w3);
        out.weight[1][l] = w1;
        out.weight[2][l] = w2;
        out.weight[3][l] = w3;
        out.direction[0][l] = d[0];
        out.direction[1][l] = d[1];
        out.direction[2][l] = d[2];
        out.length[l] = dot(a, s1) * scale;
        out.rest_length[l] = rest_length;
        out.per_length[l] = 1.0 / rest_length.abs().max(rest.floor[l]);
    }
    if !all_solid {
        for l in 0..LANES {
            if !solid[l] {
                set_collinear(&mut out, x, rest, l);
            }
        }
    }
    out
}

#[cold]
#[inline(never)]
fn set_collinear(out: &mut AltitudeLanes, x: [&Lane3; 4], rest: &AltitudeRestLanes, lane: usize) {
    let corners = x.map(|p| Vector3::new(p[0][lane], p[1][lane], p[2][lane]));
    let found = collinear(&corners, &rest.get(lane));
    let (weight, per_length) = found.map_or(([0.0; 4], 0.0), |a| (a.weight, a.per_length));
    let direction = found.map_or(Vector3::zeros(), |a| a.direction);
    for p in 0..4 {
        out.weight[p][lane] = weight[p];
    }
    for k in 0..3 {
        out.direction[k][lane] = direction[k];
    }
    out.length[lane] = 0.0;
    out.rest_length[lane] = found.map_or(0.0, |a| a.rest_length);
    out.per_length[lane] = per_length;
}

#[inline(always)]
fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

#[inline(always)]
fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1].mul_add(b[2], -(a[2] * b[1])), a[2].mul_add(b[0], -(a[0] * b[2])), a[0].mul_add(b[1], -(a[1] * b[0]))]
}
