//! Several stores read as one: recorded sequences that were simulated apart, in a stated order.

use super::{FrameInfo, FrameSource, FrameStore};
use crate::error::{Error, Result};

/// Frames of several stores, one after the other. A store's frames become the sequence of its place in the list.
#[derive(Debug)]
pub struct JoinedFrames {
    stores: Vec<FrameStore>,
    /// First frame of each store; one more than there are stores.
    start: Vec<usize>,
}

impl JoinedFrames {
    /// Joins `stores`.
    ///
    /// # Errors
    /// When there is none, or they are of different hair.
    pub fn new(stores: Vec<FrameStore>) -> Result<Self> {
        let Some(first) = stores.first() else {
            return Err(Error::BadFrame { reason: "no sequence was recorded".into() });
        };
        let (n_strands, n_particles) = (first.n_strands(), first.n_particles());
        let mut start = vec![0];
        for store in &stores {
            if (store.n_strands(), store.n_particles()) != (n_strands, n_particles) {
                let reason = format!(
                    "{} has {} strands of {} particles, {} has {n_strands} of {n_particles}",
                    store.path.display(),
                    store.n_strands(),
                    store.n_particles(),
                    first.path.display()
                );
                return Err(Error::BadFrame { reason });
            }
            start.push(start[start.len() - 1] + store.n_frames());
        }
        Ok(Self { stores, start })
    }

    /// The store a frame lies in, and its number there.
    fn place(&self, frame: usize) -> (usize, usize) {
        let store = self.start.partition_point(|&s| s <= frame).clamp(1, self.stores.len()) - 1;
        (store, frame - self.start[store])
    }
}

impl FrameSource for JoinedFrames {
    fn n_strands(&self) -> usize {
        self.stores[0].n_strands()
    }
    fn n_particles(&self) -> usize {
        self.stores[0].n_particles()
    }
    fn n_frames(&self) -> usize {
        self.start[self.stores.len()]
    }
    fn info(&self, frame: usize) -> FrameInfo {
        let (store, at) = self.place(frame);
        FrameInfo { sequence: store as u32, ..self.stores[store].info(at) }
    }
    fn read(&self, frame: usize, out: &mut [[f32; 3]]) -> Result<()> {
        let (store, at) = self.place(frame);
        self.stores[store].read(at, out)
    }
}

#[cfg(test)]
mod tests {
    use super::super::FrameStoreWriter;
    use super::*;

    fn store(directory: &std::path::Path, name: &str, n_strands: usize, n_frames: usize) -> FrameStore {
        let path = directory.join(name);
        let mut writer = FrameStoreWriter::create(&path, n_strands, 2, 1).unwrap();
        for f in 0..n_frames {
            let points = vec![[f as f32, name.len() as f32, 0.0]; n_strands * 2];
            writer.append(FrameInfo { sequence: 9, time_s: f as f64 }, &points).unwrap();
        }
        writer.finish().unwrap();
        FrameStore::open(&path).unwrap()
    }

    #[test]
    fn frames_of_joined_stores_come_in_order_each_store_a_sequence() {
        let directory = tempfile::tempdir().unwrap();
        let of = |name, n| store(directory.path(), name, 3, n);
        let joined = JoinedFrames::new(vec![of("a", 2), of("bb", 0), of("ccc", 3)]).unwrap();
        assert_eq!((joined.n_frames(), joined.n_strands(), joined.n_particles()), (5, 3, 2));
        let mut points = vec![[0.0; 3]; 6];
        for (frame, (sequence, at, name)) in
            [(0, 0, 1), (0, 1, 1), (2, 0, 3), (2, 1, 3), (2, 2, 3)].into_iter().enumerate()
        {
            assert_eq!(joined.info(frame), FrameInfo { sequence, time_s: f64::from(at) });
            joined.read(frame, &mut points).unwrap();
            assert_eq!(points[5], [at as f32, name as f32, 0.0]);
        }
        assert!(joined.read(5, &mut points).is_err());
    }

    #[test]
    fn stores_of_different_hair_are_refused() {
        let directory = tempfile::tempdir().unwrap();
        let stores = vec![store(directory.path(), "a", 3, 1), store(directory.path(), "b", 4, 1)];
        let error = JoinedFrames::new(stores).unwrap_err().to_string();
        assert!(error.contains("4 strands") && error.contains("3 of 2"), "{error}");
        assert!(JoinedFrames::new(Vec::new()).is_err());
    }
}
