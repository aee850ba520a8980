//! Baked solids kept on disk, by the content they were baked from.
//!
//! A name is the xxh3-128 of mesh, parameters and version: what changes any of them is another file, and nothing is ever out
//! of date. Files are enveloped, written beside and renamed. A file that cannot be used is as good as none: the caller
//! bakes again and is told why. Knows nothing of what the bytes mean.

use std::path::{Path, PathBuf};

use xxhash_rust::xxh3::Xxh3;

use crate::envelope::{self, Kind};
use crate::error::{Error, Result};
use crate::mesh::TriMesh;

/// Version of the envelope's use, not of what is in it.
const VERSION: u32 = 1;

/// What a baked solid was made from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BakeKey(u128);

impl BakeKey {
    /// Of a mesh, the parameters of its baking as the caller writes them, and the version of the code that bakes.
    #[must_use]
    pub fn new(mesh: &TriMesh, params: &[u8], version: u32) -> Self {
        let mut hash = Xxh3::new();
        hash.update(&version.to_le_bytes());
        // With their lengths, so that no two lists run together.
        hash.update(&(params.len() as u64).to_le_bytes());
        hash.update(params);
        hash.update(&(mesh.vertices.len() as u64).to_le_bytes());
        hash.update(bytemuck::cast_slice(&mesh.vertices));
        hash.update(bytemuck::cast_slice(&mesh.triangles));
        Self(hash.digest128())
    }
}

/// A directory of baked solids.
#[derive(Debug, Clone)]
pub struct BakeCache {
    directory: PathBuf,
}

impl BakeCache {
    /// The cache in a directory, which need not be there yet.
    #[must_use]
    pub fn in_directory(directory: &Path) -> Self {
        Self { directory: directory.to_path_buf() }
    }

    /// File of a key.
    #[must_use]
    pub fn path(&self, key: BakeKey) -> PathBuf {
        self.directory.join(format!("{:032x}.sdf", key.0))
    }

    /// The bytes kept under a key; none when nothing was kept.
    ///
    /// # Errors
    /// When there is a file that cannot be read or is damaged: bake again.
    pub fn load(&self, key: BakeKey) -> Result<Option<Vec<u8>>> {
        match envelope::read(&self.path(key), Kind::BAKED_SOLID, VERSION) {
            Ok(payload) => Ok(Some(payload)),
            Err(Error::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(e) => Err(e),
        }
    }

    /// Keeps bytes under a key.
    ///
    /// # Errors
    /// When the directory or the file cannot be written.
    pub fn store(&self, key: BakeKey, payload: &[u8]) -> Result<()> {
        std::fs::create_dir_all(&self.directory).map_err(Error::io("create", &self.directory))?;
        envelope::write(&self.path(key), Kind::BAKED_SOLID, VERSION, payload)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mesh() -> TriMesh {
        TriMesh {
            vertices: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        }
    }

    #[test]
    fn what_is_kept_comes_back_and_damage_is_told_from_absence() {
        let directory = tempfile::tempdir().unwrap();
        let cache = BakeCache::in_directory(&directory.path().join("baked"));
        let key = BakeKey::new(&mesh(), b"cell 0.1", 1);
        assert!(cache.load(key).unwrap().is_none());
        cache.store(key, b"a field").unwrap();
        assert_eq!(cache.load(key).unwrap().as_deref(), Some(&b"a field"[..]));
        let sound = std::fs::read(cache.path(key)).unwrap();
        for n in 0..sound.len() {
            let mut broken = sound.clone();
            broken[n] ^= 1;
            std::fs::write(cache.path(key), &broken).unwrap();
            assert!(cache.load(key).is_err(), "byte {n}");
            std::fs::write(cache.path(key), &sound[..n]).unwrap();
            assert!(cache.load(key).is_err(), "cut at {n}");
        }
        cache.store(key, b"a field").unwrap();
        assert!(cache.load(key).unwrap().is_some());
    }

    #[test]
    fn a_change_of_mesh_parameters_or_version_is_another_key() {
        let key = BakeKey::new(&mesh(), b"cell 0.1", 1);
        let mut moved = mesh();
        moved.vertices[3][2] = 1.0f32.next_up();
        let mut turned = mesh();
        turned.triangles[0].swap(0, 1);
        for other in [
            BakeKey::new(&moved, b"cell 0.1", 1),
            BakeKey::new(&turned, b"cell 0.1", 1),
            BakeKey::new(&mesh(), b"cell 0.2", 1),
            BakeKey::new(&mesh(), b"cell 0.1", 2),
        ] {
            assert!(other != key);
        }
        assert_eq!(BakeKey::new(&mesh(), b"cell 0.1", 1), key);
    }
}
