//! From where a picture is taken: a perspective camera, its axes and its walk around what it looks at.

use nalgebra::{Matrix3, Vector3};

/// A perspective camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Where it stands, cm.
    pub eye: [f32; 3],
    /// What it looks at, cm.
    pub target: [f32; 3],
    /// Vertical field of view, radian.
    pub vertical_fov: f32,
    /// Width of the picture, pixels.
    pub width: usize,
    /// Height of the picture, pixels.
    pub height: usize,
}

impl Camera {
    /// A camera `distance` cm from `target`, `turn` radian about y from the front (+z) towards +x, slightly raised.
    pub fn around(target: [f32; 3], distance: f32, turn: f32, width: usize, height: usize) -> Self {
        let (sin, cos) = turn.sin_cos();
        let eye = [target[0] + distance * sin, target[1] + 0.12 * distance, target[2] + distance * cos];
        Self { eye, target, vertical_fov: 0.45, width, height }
    }

    /// The same camera turned by `turn` radian about the vertical through its target, from +z towards +x.
    #[must_use]
    pub fn turned(&self, turn: f32) -> Self {
        let (sin, cos) = turn.sin_cos();
        let [x, y, z] = [0, 1, 2].map(|k| self.eye[k] - self.target[k]);
        let turned = [cos * x + sin * z, y, cos * z - sin * x];
        Self { eye: [0, 1, 2].map(|k| self.target[k] + turned[k]), ..*self }
    }

    /// `n` cameras at equal angles once around the target, this one first.
    pub fn turntable(&self, n: usize) -> impl Iterator<Item = Self> + '_ {
        (0..n).map(move |k| self.turned(std::f32::consts::TAU * k as f32 / n as f32))
    }

    /// Right, up and backward unit vectors as rows.
    pub fn axes(&self) -> Matrix3<f32> {
        viewer_axes(Vector3::from(self.target) - Vector3::from(self.eye))
    }

    /// Width of a pixel at a distance of 1 cm, cm.
    pub fn pixel_at_one(&self) -> f32 {
        2.0 * (0.5 * self.vertical_fov).tan() / self.height as f32
    }
}

/// Right, up and backward unit vectors of a viewer who looks along `forward`, as rows.
pub fn viewer_axes(forward: Vector3<f32>) -> Matrix3<f32> {
    let back = -forward.try_normalize(1e-12).unwrap_or(-Vector3::z());
    let up = if back.y.abs() > 0.99 { Vector3::z() } else { Vector3::y() };
    let right = up.cross(&back).try_normalize(1e-12).unwrap_or(Vector3::x());
    Matrix3::from_rows(&[right.transpose(), back.cross(&right).transpose(), back.transpose()])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sines and cosines of f32 over distances of 100 cm.
    const ROUND_OFF: f32 = 1e-4;

    fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
        (Vector3::from(a) - Vector3::from(b)).norm()
    }

    #[test]
    fn a_turntable_keeps_its_distance_and_height_and_comes_around() {
        let first = Camera::around([1.0, -8.0, 3.0], 70.0, 0.3, 64, 48);
        let all: Vec<Camera> = first.turntable(8).collect();
        assert!(distance(all[0].eye, first.eye) < ROUND_OFF);
        for c in &all {
            assert!((distance(c.eye, c.target) - distance(first.eye, first.target)).abs() < ROUND_OFF);
            assert!((c.eye[1] - first.eye[1]).abs() < ROUND_OFF);
        }
        // Opposite after half a turn, and the next step would be the first again.
        let middle = [0, 2].map(|k| 0.5 * (all[0].eye[k] + all[4].eye[k]) - first.target[k]);
        assert!(middle[0].abs() < ROUND_OFF && middle[1].abs() < ROUND_OFF);
        assert!(distance(all[7].turned(std::f32::consts::TAU / 8.0).eye, first.eye) < ROUND_OFF);
    }

    #[test]
    fn turning_goes_the_way_of_around() {
        let front = Camera::around([0.0; 3], 50.0, 0.0, 64, 48);
        let side = Camera::around([0.0; 3], 50.0, 1.2, 64, 48);
        assert!(distance(front.turned(1.2).eye, side.eye) < ROUND_OFF);
    }

    #[test]
    fn axes_are_orthonormal_even_looking_straight_down() {
        for target in [[0.0, 0.0, 0.0], [0.0, -9.0, 10.0], [4.0, 2.0, 10.0]] {
            let camera = Camera { eye: [0.0, 0.0, 10.0], target, vertical_fov: 0.5, width: 4, height: 4 };
            let axes = camera.axes();
            assert!((axes * axes.transpose() - Matrix3::identity()).norm() < ROUND_OFF);
            assert!((axes.determinant() - 1.0).abs() < ROUND_OFF);
        }
    }
}
