//! Perturbed particles of straight hair (MS08 §3.2, Fig. 6d, 7b).
//!
//! Each stands beside the middle of its segment at the height of an equilateral triangle, and successive ones turn about
//! the hair by a right angle so that every bending direction is sampled. The turning frame is carried along the strand
//! without twist. They share the strand's mass and take no part in contact or pictures.

use super::{Perturbed, Topology};
use nalgebra::Vector3;

/// Turn between successive perturbed particles, radians.
const TURN: f64 = std::f64::consts::FRAC_PI_2;

/// Sine of the turn at a particle below which three particles count as collinear.
const COLLINEAR_SINE: f64 = 0.5;

/// Parts of equal length that a strand is divided into: each is perturbed wholly or not at all. Departure from MS08 §3.2,
/// which perturbs single segments: runs end on these marks, so that strands of few topologies fill vector lanes.
const PARTS: usize = 4;

/// Where a strand needs perturbed particles (MS08 §3.2): beside segments collinear with a neighbour, rounded outwards to
/// quarters of the strand.
#[must_use]
pub fn where_straight(points: &[Vector3<f64>]) -> Perturbed {
    let n_segments = points.len() - 1;
    let part_of = |segment: usize| segment * PARTS / n_segments;
    let mut straight = [false; PARTS];
    for (i, w) in points.windows(3).enumerate() {
        let (u, v) = (w[1] - w[0], w[2] - w[1]);
        if u.cross(&v).norm() < COLLINEAR_SINE * u.norm() * v.norm() {
            straight[part_of(i)] = true;
            straight[part_of(i + 1)] = true;
        }
    }
    Perturbed((0..n_segments).map(|segment| straight[part_of(segment)]).collect())
}

/// All rig particles of a strand whose own particles are `points`, in rig order.
#[must_use]
pub fn rig_particles(topology: &Topology, points: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let mut out = Vec::with_capacity(topology.n_rig);
    let mut tangent = segment_direction(points[0], points[1]);
    let mut across = any_perpendicular(tangent);
    for (j, pair) in points.windows(2).enumerate() {
        let next = segment_direction(pair[0], pair[1]);
        across = carry(across, tangent, next);
        tangent = next;
        out.push(pair[0]);
        if topology.perturbed.0[j] {
            let (sin, cos) = (TURN * j as f64).sin_cos();
            let side = across * cos + tangent.cross(&across) * sin;
            let height = (pair[1] - pair[0]).norm() * 0.75_f64.sqrt();
            out.push((pair[0] + pair[1]) / 2.0 + side * height);
        }
    }
    out.extend(points.last());
    out
}

fn segment_direction(a: Vector3<f64>, b: Vector3<f64>) -> Vector3<f64> {
    (b - a).try_normalize(f64::MIN_POSITIVE).unwrap_or_else(Vector3::y)
}

fn any_perpendicular(t: Vector3<f64>) -> Vector3<f64> {
    let axis = if t.x.abs() < 0.6 { Vector3::x() } else { Vector3::z() };
    t.cross(&axis).normalize()
}

/// Carries a vector perpendicular to `from` to one perpendicular to `to` by the smallest rotation between them.
fn carry(v: Vector3<f64>, from: Vector3<f64>, to: Vector3<f64>) -> Vector3<f64> {
    let reflected = v - (from + to) * (v.dot(&(from + to)) / (1.0 + from.dot(&to)).max(1e-12));
    // The smallest rotation applied to v ⟂ from is v − (v·to)/(1 + from·to)·(from + to); written on the sum it needs v·from = 0.
    (reflected - to * reflected.dot(&to)).try_normalize(1e-12).unwrap_or_else(|| any_perpendicular(to))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn perturbed_particles_form_equilateral_triangles_with_their_segment() {
        let points: Vec<_> = (0..25).map(|i| Vector3::new(0.02 * f64::from(i * i), -f64::from(i), 0.0)).collect();
        let topology = Topology::new(&Perturbed::everywhere(points.len()));
        let rig = rig_particles(&topology, &points);
        for j in 0..24 {
            let length = (points[j + 1] - points[j]).norm();
            for corner in [rig[2 * j], rig[2 * j + 2]] {
                assert!(((rig[2 * j + 1] - corner).norm() / length - 1.0).abs() < 1e-12);
            }
        }
    }

    fn line_then_helix(n_straight: usize) -> Vec<Vector3<f64>> {
        let mut at = Vector3::zeros();
        let mut points = vec![at];
        for i in 1..25 {
            let angle = 0.9 * (i as f64 - n_straight as f64).max(0.0);
            at += Vector3::new(0.8 * angle.sin(), -0.6, 0.8 * angle.cos()).normalize();
            points.push(at);
        }
        points
    }

    #[test]
    fn perturbed_particles_stand_where_the_hair_is_straight_and_there_only() {
        assert_eq!(where_straight(&line_then_helix(25)), Perturbed::everywhere(25));
        assert_eq!(where_straight(&line_then_helix(0)), Perturbed::nowhere(25));
        let half = where_straight(&line_then_helix(12));
        assert_eq!(half.0, (0..24).map(|j| j < 12).collect::<Vec<_>>());
    }
}
