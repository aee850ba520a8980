//! The guides' transforms of one recorded frame, as arrays over particles.
//!
//! They are the B_g(i, f) of AS16 Eq. (5) and (7), shared with the runtime ([`io_formats::guide_transform`]), in the kind that
//! the model is trained for; training measures the other kind on some strands beside it.

use io_formats::UniformGroom;
use io_formats::guide_transform::{Blend, DisplacementTransform, guide_transforms};
use rayon::prelude::*;

/// Numbers of one transform: nine of the linear part by rows, three of the offset.
pub const NUMBERS: usize = 12;

/// Transforms of all guides in one frame.
#[derive(Debug, Clone, Default)]
pub struct FrameTransforms {
    n_particles: usize,
    /// `n_guides * NUMBERS * n_particles` numbers: per guide, twelve arrays over particles, root first.
    values: Vec<f32>,
    scratch: Vec<DisplacementTransform>,
}

impl FrameTransforms {
    /// Computes the transforms of the guides from their rest shape and one `frame` of all strands (cm, head frame).
    ///
    /// # Panics
    /// If the frame has another number of points than `rest`, or there is no such guide strand.
    pub fn fill(&mut self, rest: &UniformGroom, guide_strands: &[u32], frame: &[[f32; 3]], blend: Blend) {
        let n = rest.n_particles;
        assert_eq!(frame.len(), rest.points.len(), "a frame must have the points of the rest shape");
        self.n_particles = n;
        self.values.resize(guide_strands.len() * NUMBERS * n, 0.0);
        self.scratch.resize(guide_strands.len() * n, DisplacementTransform::default());
        let per_guide = self.values.par_chunks_mut(NUMBERS * n).zip(self.scratch.par_chunks_mut(n)).zip(guide_strands);
        per_guide.for_each(|((values, scratch), &strand)| {
            let at = strand as usize * n;
            let (rest, current) = (rest.strand(strand as usize), &frame[at..at + n]);
            guide_transforms(rest, current, blend, scratch);
            for (i, t) in scratch.iter().enumerate() {
                for (r, row) in t.linear.iter().enumerate() {
                    for (c, &x) in row.iter().enumerate() {
                        values[(3 * r + c) * n + i] = x;
                    }
                }
                for (c, &x) in t.offset.iter().enumerate() {
                    values[(9 + c) * n + i] = x;
                }
            }
        });
    }

    /// Twelve arrays of `n_particles` numbers: the linear part by rows, then the offset (cm).
    ///
    /// # Panics
    /// If there is no such guide.
    #[must_use]
    pub fn of_guide(&self, guide: usize) -> &[f32] {
        let n = NUMBERS * self.n_particles;
        &self.values[guide * n..(guide + 1) * n]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_arrays_hold_the_transform_of_each_particle() {
        let rest = UniformGroom {
            n_strands: 2,
            n_particles: 3,
            points: vec![[0.0; 3], [0.0, 1.0, 0.0], [0.0, 2.0, 0.0], [5.0, 0.0, 0.0], [5.0, 1.0, 0.0], [5.0, 2.0, 1.0]],
        };
        let mut frame = rest.points.clone();
        frame[4] = [5.5, 0.8, 0.1];
        frame[5] = [6.5, 0.9, 0.3];
        let mut expected = [DisplacementTransform::default(); 3];
        guide_transforms(rest.strand(1), &frame[3..], Blend::Rigid, &mut expected);
        let mut transforms = FrameTransforms::default();
        transforms.fill(&rest, &[0, 1], &frame, Blend::Rigid);
        assert!(transforms.of_guide(0).iter().all(|&x| x == 0.0), "guide 0 is at rest");
        for (i, t) in expected.iter().enumerate() {
            let at = |number: usize| transforms.of_guide(1)[number * 3 + i];
            assert_eq!([at(3), at(4), at(5)], t.linear[1]);
            assert_eq!([at(9), at(10), at(11)], t.offset);
        }
        transforms.fill(&rest, &[0, 1], &frame, Blend::Translation);
        assert_eq!(transforms.of_guide(1)[9 * 3 + 1], 0.5);
        assert!(transforms.of_guide(1)[..27].iter().all(|&x| x == 0.0), "no turning");
    }
}
