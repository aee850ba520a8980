//! Solids as strands see them: poses in the head frame, in single precision.

use collision::{Solid, SolidPose};
use nalgebra::Isometry3;

/// A rigid motion in single precision, by rows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    turn: [[f32; 3]; 3],
    shift: [f32; 3],
}

impl Frame {
    pub(crate) fn new(pose: &Isometry3<f64>) -> Self {
        let turn = pose.rotation.to_rotation_matrix().into_inner();
        Self {
            turn: std::array::from_fn(|r| std::array::from_fn(|c| turn[(r, c)] as f32)),
            shift: pose.translation.vector.cast::<f32>().into(),
        }
    }

    /// Row `r` of the rotation, and of the translation.
    #[inline(always)]
    pub(crate) fn row(&self, r: usize) -> ([f32; 3], f32) {
        (self.turn[r], self.shift[r])
    }

    #[inline(always)]
    pub(crate) fn point(&self, p: [f32; 3]) -> [f32; 3] {
        let v = self.vector(p);
        [v[0] + self.shift[0], v[1] + self.shift[1], v[2] + self.shift[2]]
    }

    #[inline(always)]
    pub(crate) fn vector(&self, v: [f32; 3]) -> [f32; 3] {
        let [a, b, c] = &self.turn;
        [
            a[0] * v[0] + a[1] * v[1] + a[2] * v[2],
            b[0] * v[0] + b[1] * v[1] + b[2] * v[2],
            c[0] * v[0] + c[1] * v[1] + c[2] * v[2],
        ]
    }

    /// The vector turned the other way.
    #[inline(always)]
    pub(crate) fn vector_back(&self, v: [f32; 3]) -> [f32; 3] {
        let [a, b, c] = &self.turn;
        [
            a[0] * v[0] + b[0] * v[1] + c[0] * v[2],
            a[1] * v[0] + b[1] * v[1] + c[1] * v[2],
            a[2] * v[0] + b[2] * v[1] + c[2] * v[2],
        ]
    }
}

/// A solid on its way through a step, in the head frame.
#[derive(Clone, Debug)]
pub(crate) struct SolidInHead<'a> {
    pub solid: &'a Solid,
    pub pose: SolidPose,
    /// Solid from head at the end of the step.
    pub at_end: Frame,
    /// Where what it carries with it goes over the step, head frame.
    pub carries: Frame,
    /// Farthest that any of its points moves, cm.
    pub moved: f32,
}

impl<'a> SolidInHead<'a> {
    pub(crate) fn new(solid: &'a Solid, pose: SolidPose) -> Self {
        let moved = pose.max_displacement(&solid.sdf.bounds()) as f32;
        Self {
            solid,
            at_end: Frame::new(&pose.to.inverse()),
            carries: Frame::new(&(pose.to * pose.from.inverse())),
            pose,
            moved,
        }
    }

    /// Where a point would be at the end of the step had it gone with the solid.
    pub(crate) fn carried(&self, point: [f32; 3]) -> [f32; 3] {
        self.carries.point(point)
    }

    /// Solid from head at a fraction of the step.
    pub(crate) fn at(&self, alpha: f64) -> Frame {
        if alpha >= 1.0 { self.at_end } else { Frame::new(&self.pose.at(alpha).inverse()) }
    }
}

/// Particle `i` of a strand kept as three arrays of `pad` values.
#[inline(always)]
pub(crate) fn particle(x: &[f32], pad: usize, i: usize) -> [f32; 3] {
    [x[i], x[pad + i], x[2 * pad + i]]
}
