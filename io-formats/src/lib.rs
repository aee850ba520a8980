//! What crosses a stage boundary, and its bytes: grooms, recorded frames, skinning models, meshes, motions, scenes.
//!
//! Only this crate and the binaries touch files. Every reader checks each count against the length of the file before it
//! allocates, names the file, the field and the offset in its error, and converts to centimetre, gram, second, radian.
//! Positions held in memory and in our own files are little-endian `f32` triples.
//!
//! ```
//! use io_formats::{Groom, LengthUnit};
//!
//! let unit: LengthUnit = "mm".parse()?;
//! let groom = Groom::from_strands(&[vec![[0.0, 0.0, 0.0], [0.0, 0.0, 120.0]]])
//!     .transformed(unit.cm_per_unit() as f32, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [0.0; 3]);
//! let uniform = groom.resample(25)?;
//! assert_eq!(uniform.strand(0)[24], [0.0, 0.0, 12.0]);
//! # Ok::<(), io_formats::Error>(())
//! ```

#[cfg(target_endian = "big")]
compile_error!(
    "frames and models are read in place as little-endian numbers; a big-endian port needs a byte swap here"
);

mod bytes;

pub mod bake_cache;
pub mod bvh;
pub mod densify;
pub mod envelope;
pub mod error;
pub mod frames;
pub mod groom;
pub mod guide_transform;
pub mod hair;
pub mod mesh;
pub mod motion;
pub mod ply;
pub mod scene;
pub mod skinning_model;
pub mod stage_cache;
pub mod tfx;
pub mod usc;
pub mod usd;

pub use bake_cache::{BakeCache, BakeKey};
pub use bvh::Bvh;
pub use error::{Error, Result};
pub use frames::{FrameInfo, FrameSource, FrameStore, FrameStoreWriter, JoinedFrames, MemoryFrames};
pub use groom::{Groom, LengthUnit, UniformGroom, read_groom};
pub use hair::{read_hair, write_hair};
pub use mesh::{TriMesh, read_mesh, read_obj, read_stl, write_obj};
pub use motion::{MotionEnd, PoseKey, PoseMotion};
pub use ply::read_ply;
pub use scene::Scene;
pub use skinning_model::{MaterialRecord, SkinningModel, WeightPoly};
pub use stage_cache::{StageCache, StageCost, StageLock};
pub use tfx::read_tfx;
pub use usd::{CurvesLook, UsdaTiming, UsdaWriter};
