//! What is measured on the shape of one strand: writhe, turns, strain, tortuosity, symmetry.
//!
//! Every measure is of the polyline through the hair's own particles and does not depend on where it stands.

use nalgebra::Vector3;
use std::f64::consts::TAU;

/// Writhe: how often a curve crosses itself, signed, averaged over all views. A loop counts about one.
///
/// The Gauss integral of two straight segments is the area of the spherical quadrangle of their four differences (Klenin
/// and Langowski 2000, method 1a).
#[must_use]
pub fn writhe(points: &[Vector3<f64>]) -> f64 {
    let mut sum = 0.0;
    for i in 0..points.len() - 1 {
        for j in i + 2..points.len() - 1 {
            let (a, b, c, d) = (points[i], points[i + 1], points[j], points[j + 1]);
            let volume = (d - c).cross(&(b - a)).dot(&(c - a));
            // Segments of one plane, crossing or not, add nothing: half the views see either sign.
            if volume == 0.0 {
                continue;
            }
            let sides = [c - a, d - a, d - b, c - b];
            let normal = |k: usize| sides[k].cross(&sides[(k + 1) % 4]).try_normalize(1e-14);
            let [Some(n0), Some(n1), Some(n2), Some(n3)] = [0, 1, 2, 3].map(normal) else { continue };
            let angle = |u: Vector3<f64>, v: Vector3<f64>| u.dot(&v).clamp(-1.0, 1.0).asin();
            let area = angle(n0, n1) + angle(n1, n2) + angle(n2, n3) + angle(n3, n0);
            sum += area * volume.signum();
        }
    }
    // Each pair stands for two of the double integral over 4π.
    2.0 * sum / (2.0 * TAU)
}

/// Largest angle between neighbouring segments, radian.
#[must_use]
pub fn largest_turn(points: &[Vector3<f64>]) -> f64 {
    points.windows(3).map(|w| (w[1] - w[0]).angle(&(w[2] - w[1]))).fold(0.0, f64::max)
}

/// Largest distance from the line through the first point along a unit vector, cm.
#[must_use]
pub fn off_axis(points: &[Vector3<f64>], axis: &Vector3<f64>) -> f64 {
    points.iter().map(|p| (p - points[0]).cross(axis).norm()).fold(0.0, f64::max)
}

/// Sum of the segments' lengths, cm.
#[must_use]
pub fn arc_length(points: &[Vector3<f64>]) -> f64 {
    points.windows(2).map(|w| (w[1] - w[0]).norm()).sum()
}

/// Arc length over the distance of the ends: 1 for a straight strand, more for a wavy one.
#[must_use]
pub fn tortuosity(points: &[Vector3<f64>]) -> f64 {
    let chord = points.first().zip(points.last()).map_or(0.0, |(a, b)| (b - a).norm());
    arc_length(points) / chord.max(f64::MIN_POSITIVE)
}

/// Largest |l/l₀ - 1| over the segments of strands of `n` particles.
#[must_use]
pub fn largest_strain(now: &[Vector3<f64>], rest: &[Vector3<f64>], n: usize) -> f64 {
    strains(now, rest, n).map(f64::abs).fold(0.0, f64::max)
}

/// Strain l/l₀ - 1 of every segment of strands of `n` particles.
pub fn strains<'a>(now: &'a [Vector3<f64>], rest: &'a [Vector3<f64>], n: usize) -> impl Iterator<Item = f64> + 'a {
    now.chunks_exact(n)
        .zip(rest.chunks_exact(n))
        .flat_map(|(now, rest)| now.windows(2).zip(rest.windows(2)))
        .map(|(w, r)| (w[1] - w[0]).norm() / (r[1] - r[0]).norm() - 1.0)
}

/// Root mean square distance of equal points, cm.
#[must_use]
pub fn rms_distance(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(p, q)| (p - q).norm_squared()).sum();
    (sum / a.len().max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn helix(n: usize, turns: f64, pitch_sine: f64) -> Vec<Vector3<f64>> {
        let cosine = (1.0 - pitch_sine * pitch_sine).sqrt();
        (0..n)
            .map(|i| {
                let angle = TAU * turns * i as f64 / (n - 1) as f64;
                Vector3::new(cosine * angle.cos(), cosine * angle.sin(), pitch_sine * angle)
            })
            .collect()
    }

    #[test]
    fn the_writhe_of_a_long_helix_is_that_of_its_tangents_cone() {
        /// Ends count for about one turn of twenty.
        const END_SHARE: f64 = 0.06;
        for sine in [0.3, 0.6, 0.9] {
            // Fuller: 1 - sin(pitch angle) for each turn, positive for a right-handed one.
            let expected = 20.0 * (1.0 - sine);
            let found = writhe(&helix(1000, 20.0, sine));
            assert!((found / expected - 1.0).abs() < END_SHARE, "{found} for {expected}");
        }
    }

    #[test]
    fn the_writhe_of_a_plane_curve_is_nothing_and_changes_sign_in_a_mirror() {
        /// Rounding of a thousand pairs of angles.
        const ROUND_OFF: f64 = 1e-9;
        let curl = helix(60, 3.0, 0.4);
        let flat: Vec<_> = curl.iter().map(|p| Vector3::new(p.x + 0.3 * p.z, p.y, 0.0)).collect();
        assert!(writhe(&flat).abs() < ROUND_OFF);
        let mirrored: Vec<_> = curl.iter().map(|p| Vector3::new(-p.x, p.y, p.z)).collect();
        assert!((writhe(&curl) + writhe(&mirrored)).abs() < ROUND_OFF);
    }

    #[test]
    fn a_straight_strand_has_tortuosity_one_and_no_turn() {
        const ROUND_OFF: f64 = 1e-6;
        let line: Vec<_> = (0..9).map(|i| Vector3::new(0.3, 1.0, -2.0) * f64::from(i)).collect();
        assert!((tortuosity(&line) - 1.0).abs() < ROUND_OFF && largest_turn(&line) < ROUND_OFF);
        assert!(tortuosity(&helix(100, 4.0, 0.5)) > 1.5);
    }
}
