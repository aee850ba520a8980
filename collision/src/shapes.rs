//! Closed-form signed distances: solids made by tools, and the truth that tests compare grids with.
//!
//! Every shape's distance is exact, inside and out. A union takes the least of its members, exact outside; with
//! smoothing it blends them instead, which stays 1-Lipschitz (its gradient is a convex mix of theirs) and thus a lower
//! bound of the distance to the blended surface.

use nalgebra::Vector3;

use crate::sdf::Bounds;

/// A solid with a closed-form distance; lengths in cm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// A ball.
    Sphere {
        /// Middle.
        center: Vector3<f32>,
        /// Radius.
        radius: f32,
    },
    /// All points within a radius of a segment, the radius running linearly from one end to the other. A rod or a tooth.
    Capsule {
        /// One end of the segment.
        a: Vector3<f32>,
        /// The other end.
        b: Vector3<f32>,
        /// Radius at `a`.
        radius_a: f32,
        /// Radius at `b`; its difference from `radius_a` should stay below the length, or one ball swallows the other.
        radius_b: f32,
    },
    /// An axis-aligned box with rounded edges.
    Box {
        /// Middle.
        center: Vector3<f32>,
        /// Half of each edge, rounding included.
        half: Vector3<f32>,
        /// Radius of the edges, at most the least half edge.
        rounding: f32,
    },
    /// A ring about the y axis through its middle.
    Torus {
        /// Middle.
        center: Vector3<f32>,
        /// Radius of the ring.
        major: f32,
        /// Radius of the tube.
        minor: f32,
    },
    /// An axis-aligned ellipsoid.
    Ellipsoid {
        /// Middle.
        center: Vector3<f32>,
        /// Semi-axes, all positive.
        radii: Vector3<f32>,
    },
}

impl Shape {
    /// A ball.
    pub fn sphere(center: Vector3<f32>, radius: f32) -> Self {
        Self::Sphere { center, radius }
    }

    /// A rod with round ends, of one radius.
    pub fn capsule(a: Vector3<f32>, b: Vector3<f32>, radius: f32) -> Self {
        Self::Capsule { a, b, radius_a: radius, radius_b: radius }
    }

    /// Signed distance at `p`, cm.
    pub fn distance(&self, p: Vector3<f32>) -> f32 {
        match *self {
            Self::Sphere { center, radius } => (p - center).norm() - radius,
            Self::Capsule { a, b, radius_a, radius_b } => capsule_distance(p, a, b, radius_a, radius_b),
            Self::Box { center, half, rounding } => {
                let q = (p - center).abs() - half.add_scalar(-rounding);
                q.sup(&Vector3::zeros()).norm() + q.max().min(0.0) - rounding
            }
            Self::Torus { center, major, minor } => {
                let q = p - center;
                (q.x.hypot(q.z) - major).hypot(q.y) - minor
            }
            Self::Ellipsoid { center, radii } => ellipsoid_distance(p - center, radii),
        }
    }

    /// The smallest axis-aligned box around the shape.
    pub fn bounds(&self) -> Bounds {
        let ball = |c: Vector3<f32>, r: f32| Bounds::new(c, c).grown(r);
        match *self {
            Self::Sphere { center, radius } => ball(center, radius),
            Self::Capsule { a, b, radius_a, radius_b } => join(ball(a, radius_a), ball(b, radius_b)),
            Self::Box { center, half, .. } => Bounds::new(center - half, center + half),
            Self::Torus { center, major, minor } => {
                let half = Vector3::new(major + minor, minor, major + minor);
                Bounds::new(center - half, center + half)
            }
            Self::Ellipsoid { center, radii } => Bounds::new(center - radii, center + radii),
        }
    }
}

/// Several shapes as one solid.
#[derive(Debug, Clone, PartialEq)]
pub struct ShapeUnion {
    /// Members; blending depends slightly on their order.
    pub shapes: Vec<Shape>,
    /// Width of the blend between neighbouring members, cm; zero leaves sharp creases.
    pub smoothing: f32,
}

impl ShapeUnion {
    /// A union with sharp creases.
    pub fn sharp(shapes: Vec<Shape>) -> Self {
        Self { shapes, smoothing: 0.0 }
    }

    /// Signed distance at `p`, cm; infinite for an empty union.
    pub fn distance(&self, p: Vector3<f32>) -> f32 {
        self.shapes.iter().fold(f32::INFINITY, |least, s| {
            // A member whose box is farther than the blend reaches leaves the result as it is. Within its box nothing is
            // known: the member may be deeper.
            let b = s.bounds();
            let to_box = (p - p.sup(&b.min).inf(&b.max)).norm();
            if to_box > 0.0 && to_box >= least + self.smoothing {
                least
            } else {
                smooth_min(least, s.distance(p), self.smoothing)
            }
        })
    }

    /// A box around the union, blends included; `None` when it is empty.
    pub fn bounds(&self) -> Option<Bounds> {
        // A blend bulges by at most a quarter of its width for each member joined.
        let bulge = 0.25 * self.smoothing * self.shapes.len().saturating_sub(1) as f32;
        self.shapes.iter().map(Shape::bounds).reduce(join).map(|b| b.grown(bulge))
    }
}

impl From<Shape> for ShapeUnion {
    fn from(shape: Shape) -> Self {
        Self::sharp(vec![shape])
    }
}

fn join(a: Bounds, b: Bounds) -> Bounds {
    Bounds::new(a.min.inf(&b.min), a.max.sup(&b.max))
}

/// Least of two distances, blended quadratically where they differ by less than `width`.
fn smooth_min(a: f32, b: f32, width: f32) -> f32 {
    let least = a.min(b);
    let overlap = width - (a - b).abs();
    // Also catches a width of zero, and the infinite start of a fold.
    if overlap > 0.0 { least - overlap * overlap * 0.25 / width } else { least }
}

fn capsule_distance(p: Vector3<f32>, a: Vector3<f32>, b: Vector3<f32>, ra: f32, rb: f32) -> f32 {
    let axis = b - a;
    let length = axis.norm();
    let taper = ra - rb;
    if length <= taper.abs() {
        // One ball holds the other.
        return ((p - a).norm() - ra).min((p - b).norm() - rb);
    }
    let u = axis / length;
    let along = (p - a).dot(&u);
    let across = (p - a - u * along).norm();
    // Of all balls strung on the axis the nearest is the one whose surface the point sees head on: from the foot of the
    // perpendicular it is shifted towards the thicker end, by the tangent of the half angle.
    let sine = taper / length;
    let cosine = (1.0 - sine * sine).sqrt();
    let foot = (along - across * sine / cosine).clamp(0.0, length);
    let (dx, radius) = (along - foot, ra - taper * foot / length);
    (dx * dx + across * across).sqrt() - radius
}

/// Exact distance to an ellipsoid about the origin, by Newton's method for the foot of the perpendicular.
fn ellipsoid_distance(p: Vector3<f32>, radii: Vector3<f32>) -> f32 {
    /// Quadratic convergence from a start within a factor of three: far fewer are used.
    const MAX_STEPS: usize = 40;
    /// Level of the foot that single precision cannot tell from the surface.
    const ON_SURFACE: f64 = 1e-12;
    let r = radii.cast::<f64>();
    // By symmetry in the first octant; a point on a plane of symmetry is nudged off it, which decides between feet
    // that are equally near.
    let y = p.cast::<f64>().abs().zip_map(&r, |y, r| y.max(1e-9 * r));
    // The foot is x = r^2 y / (t + r^2) where the sum of (r y / (t + r^2))^2 is 1. That sum falls and is convex in t,
    // so Newton's method from below, where one term alone is 1, never overshoots.
    let mut t = y.zip_map(&r, |y, r| r * y - r * r).max();
    for _ in 0..MAX_STEPS {
        let (mut level, mut slope) = (-1.0, 0.0);
        for k in 0..3 {
            let q = t + r[k] * r[k];
            let term = (r[k] * y[k] / q).powi(2);
            level += term;
            slope -= 2.0 * term / q;
        }
        if level.abs() <= ON_SURFACE {
            break;
        }
        t -= level / slope;
    }
    let foot = y.zip_map(&r, |y, r| r * r * y / (t + r * r));
    let inside = y.zip_map(&r, |y, r| (y / r).powi(2)).sum() < 1.0;
    let d = (y - foot).norm() as f32;
    if inside { -d } else { d }
}
