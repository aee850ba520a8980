//! The last few states of guides and solids: strands that are not met in every step have moved since one of them.
//!
//! A ring: taking in a state writes over the oldest, and allocates nothing.

use crate::interpolate::TransformArrays;
use nalgebra::Isometry3;

/// One state, at the end of a step.
#[derive(Clone, Debug)]
pub(crate) struct Past {
    pub transforms: TransformArrays,
    pub world_from_head: Isometry3<f64>,
    pub world_from_solids: Vec<Isometry3<f64>>,
    /// Time since the runtime was made, s.
    pub time: f64,
}

/// The last states, as many as strands may go unmet.
#[derive(Clone, Debug)]
pub(crate) struct Pasts {
    ring: Vec<Past>,
    newest: usize,
}

impl Pasts {
    /// `depth` times the state given.
    pub(crate) fn new(depth: usize, state: &Past) -> Self {
        Self { ring: vec![state.clone(); depth.max(1)], newest: 0 }
    }

    /// Takes in a state in place of the oldest.
    pub(crate) fn push(
        &mut self,
        transforms: &TransformArrays,
        world_from_head: &Isometry3<f64>,
        world_from_solids: &[Isometry3<f64>],
        time: f64,
    ) {
        self.newest = (self.newest + 1) % self.ring.len();
        let past = &mut self.ring[self.newest];
        past.transforms.copy_from(transforms);
        past.world_from_head = *world_from_head;
        past.world_from_solids.copy_from_slice(world_from_solids);
        past.time = time;
    }

    /// The newest for 1, the one before it for 2.
    pub(crate) fn back(&self, steps: usize) -> &Past {
        let n = self.ring.len();
        &self.ring[(self.newest + n + 1 - steps.clamp(1, n)) % n]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use io_formats::guide_transform::Blend;

    #[test]
    fn as_many_states_as_the_ring_is_deep_are_found_again_newest_first() {
        let still = Isometry3::identity();
        let at = |time| Past {
            transforms: TransformArrays::new(1, 2, Blend::Rigid),
            world_from_head: still,
            world_from_solids: vec![still; 2],
            time,
        };
        let mut pasts = Pasts::new(3, &at(0.0));
        for step in 1..8 {
            let now = at(f64::from(step));
            pasts.push(&now.transforms, &now.world_from_head, &now.world_from_solids, now.time);
            for back in 1..=3 {
                assert_eq!(pasts.back(back).time, f64::from((step + 1 - back as i32).max(0)));
            }
        }
    }
}
