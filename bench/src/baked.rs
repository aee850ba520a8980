//! Solids of meshes, baked once and kept.
//!
//! What is kept is the field and the thickness, under a hash of the mesh, of the parameters and of the version of the baking
//! code; name and friction are the caller's. Invariant: a solid taken from the cache is the one that would be baked, byte for
//! byte. A file that cannot be used, or written, costs a warning and a bake, never a run.

use collision::{BakeParams, FIELD_VERSION, SignedDistanceField, Solid};
use io_formats::{BakeCache, BakeKey, TriMesh};

use crate::error::Error;

/// Where a solid came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// It was baked just now.
    Baked,
    /// It was kept.
    Kept,
}

/// Bytes of the half-thickness, before those of the field.
const THICKNESS_BYTES: usize = 4;

/// The key that a mesh with these parameters is kept under.
#[must_use]
pub fn key_of(mesh: &TriMesh, params: BakeParams) -> BakeKey {
    BakeKey::new(mesh, format!("{params:?}").as_bytes(), FIELD_VERSION)
}

/// The solid of a mesh (cm), taken from the cache, or baked and kept there.
///
/// # Errors
/// As [`Solid::from_mesh`]; never because of the cache.
pub fn solid_of_mesh(
    name: &str,
    mesh: &TriMesh,
    params: BakeParams,
    friction: f32,
    cache: Option<&BakeCache>,
) -> Result<(Solid, Origin), Error> {
    let kept = cache.map(|cache| (cache, key_of(mesh, params)));
    let named = |source| Error::Bake { name: name.to_owned(), source };
    if let Some(solid) = kept.and_then(|(cache, key)| load(name, friction, cache, key)) {
        return Ok((solid.with_surface(&mesh.vertices, &mesh.triangles).map_err(named)?, Origin::Kept));
    }
    let solid = Solid::from_mesh(name, &mesh.vertices, &mesh.triangles, params, friction).map_err(named)?;
    if let Some((cache, key)) = kept {
        let mut payload = solid.half_thickness_cm.to_le_bytes().to_vec();
        payload.extend_from_slice(&solid.sdf.to_bytes());
        if let Err(error) = cache.store(key, &payload) {
            tracing::warn!(solid = name, %error, "the baked solid is not kept");
        }
    }
    Ok((solid, Origin::Baked))
}

fn load(name: &str, friction: f32, cache: &BakeCache, key: BakeKey) -> Option<Solid> {
    let path = cache.path(key);
    let payload = match cache.load(key) {
        Ok(payload) => payload?,
        Err(error) => {
            tracing::warn!(solid = name, %error, "the kept solid is baked again");
            return None;
        }
    };
    let parsed = payload.split_first_chunk::<THICKNESS_BYTES>().map(|(thickness, field)| {
        let thickness = f32::from_le_bytes(*thickness);
        SignedDistanceField::from_bytes(field).map(|sdf| (thickness, sdf))
    });
    match parsed {
        Some(Ok((half_thickness_cm, sdf))) if half_thickness_cm > 0.0 && half_thickness_cm.is_finite() => {
            Some(Solid::new(name, sdf, half_thickness_cm, friction))
        }
        Some(Err(error)) => {
            tracing::warn!(solid = name, path = %path.display(), %error, "the kept solid is baked again");
            None
        }
        _ => {
            tracing::warn!(solid = name, path = %path.display(), "the kept solid has no thickness and is baked again");
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes_bumpy::bumpy_ball;

    fn bytes(solid: &Solid) -> (Vec<u8>, u32) {
        (solid.sdf.to_bytes(), solid.half_thickness_cm.to_bits())
    }

    #[test]
    fn a_second_load_is_the_same_bytes_and_bakes_nothing() {
        let directory = tempfile::tempdir().unwrap();
        let cache = BakeCache::in_directory(&directory.path().join("solids"));
        let (ball, params) = (bumpy_ball(2, 2.0), BakeParams::with_cell(0.2));
        let get = |mesh: &TriMesh, cache| solid_of_mesh("ball", mesh, params, 0.3, cache).unwrap();
        let (first, origin) = get(&ball, Some(&cache));
        assert_eq!(origin, Origin::Baked);
        let (second, origin) = get(&ball, Some(&cache));
        assert_eq!(origin, Origin::Kept);
        assert_eq!(bytes(&first), bytes(&second));
        assert_eq!(bytes(&first), bytes(&get(&ball, None).0));

        // What is under the key is what comes, whatever a bake would give: none is made.
        let (other, _) = get(&bumpy_ball(2, 3.0), Some(&cache));
        let foreign = std::fs::read(cache.path(key_of(&bumpy_ball(2, 3.0), params))).unwrap();
        std::fs::write(cache.path(key_of(&ball, params)), foreign).unwrap();
        let (third, origin) = get(&ball, Some(&cache));
        assert_eq!((bytes(&third), origin), (bytes(&other), Origin::Kept));
    }

    #[test]
    fn a_file_that_cannot_be_used_is_baked_again_and_rewritten() {
        let directory = tempfile::tempdir().unwrap();
        let cache = BakeCache::in_directory(directory.path());
        let (ball, params) = (bumpy_ball(1, 2.0), BakeParams::with_cell(0.3));
        let key = key_of(&ball, params);
        let get = || solid_of_mesh("ball", &ball, params, 0.3, Some(&cache)).unwrap();
        let (sound, _) = get();
        let file = std::fs::read(cache.path(key)).unwrap();
        let breaks: [&dyn Fn(); 4] = [
            &|| std::fs::write(cache.path(key), &file[..file.len() / 2]).unwrap(),
            &|| std::fs::write(cache.path(key), b"not ours at all").unwrap(),
            // Whole, and yet no field; and no thickness.
            &|| cache.store(key, &[1; 100]).unwrap(),
            &|| cache.store(key, &[0; 3]).unwrap(),
        ];
        for damage in breaks {
            damage();
            let (again, origin) = get();
            assert_eq!((bytes(&again), origin), (bytes(&sound), Origin::Baked));
            assert_eq!(std::fs::read(cache.path(key)).unwrap(), file, "rewritten");
            assert_eq!(get().1, Origin::Kept);
        }
        // A directory that cannot be written to: a bake each time, and no error.
        let occupied = directory.path().join("occupied");
        std::fs::write(&occupied, b"a file").unwrap();
        let cache = BakeCache::in_directory(&occupied);
        let (again, origin) = solid_of_mesh("ball", &ball, params, 0.3, Some(&cache)).unwrap();
        assert_eq!((bytes(&again), origin), (bytes(&sound), Origin::Baked));
    }
}
