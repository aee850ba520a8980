//! Perturbed particles of straight hair (MS08 §3.2, Fig. 6d, 7b).
//!
//! Each stands beside the middle of its segment at the height of an equilateral triangle, and successive ones turn about
//! the hair by a right angle so that every bending direction is sampled. The turning frame is carried along the strand
//! without twist. They share the strand's mass and take no part in contact or pictures.

use super::{RigKind, Topology};
use nalgebra::Vector3;

/// Turn between successive perturbed particles, radians.
const TURN: f64 = std::f64::consts::FRAC_PI_2;

/// Sine of the turn at a particle below which three particles count as collinear.
const COLLINEAR_SINE: f64 = 0.25;

/// Whether a strand needs perturbed particles. MS08 perturbs single collinear runs; perturbing the whole strand is the
/// alternative it names, at the cost of particles that a partly curly strand could do without.
#[must_use]
pub fn rig_kind(points: &[Vector3<f64>]) -> RigKind {
    let collinear = points.windows(3).any(|w| {
        let (u, v) = (w[1] - w[0], w[2] - w[1]);
        u.cross(&v).norm() < COLLINEAR_SINE * u.norm() * v.norm()
    });
    if collinear { RigKind::Straight } else { RigKind::Curly }
}

/// All rig particles of a strand whose own particles are `points`, in rig order.
#[must_use]
pub fn rig_particles(topology: &Topology, points: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    if topology.kind == RigKind::Curly {
        return points.to_vec();
    }
    let mut out = Vec::with_capacity(topology.n_rig);
    let mut tangent = segment_direction(points[0], points[1]);
    let mut across = any_perpendicular(tangent);
    for (j, pair) in points.windows(2).enumerate() {
        let next = segment_direction(pair[0], pair[1]);
        across = carry(across, tangent, next);
        tangent = next;
        let (sin, cos) = (TURN * j as f64).sin_cos();
        let side = across * cos + tangent.cross(&across) * sin;
        let height = (pair[1] - pair[0]).norm() * 0.75_f64.sqrt();
        out.push(pair[0]);
        out.push((pair[0] + pair[1]) / 2.0 + side * height);
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
        let topology = Topology::new(RigKind::Straight, points.len());
        let rig = rig_particles(&topology, &points);
        for j in 0..24 {
            let length = (points[j + 1] - points[j]).norm();
            for corner in [rig[2 * j], rig[2 * j + 2]] {
                assert!(((rig[2 * j + 1] - corner).norm() / length - 1.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn only_hair_without_collinear_particles_is_curly() {
        let line: Vec<_> = (0..25).map(|i| Vector3::new(0.0, -f64::from(i), 0.0)).collect();
        let helix: Vec<_> = (0..25)
            .map(|i| {
                let angle = 0.9 * f64::from(i);
                Vector3::new(angle.cos(), -0.3 * f64::from(i), angle.sin())
            })
            .collect();
        assert_eq!(rig_kind(&line), RigKind::Straight);
        assert_eq!(rig_kind(&helix), RigKind::Curly);
    }
}
