//! Pictures of hair without a window: strands as camera-facing ribbons along smooth curves, lit solids, shadows of hair.
//!
//! - [`Image`], [`contact_sheet`], [`psnr`]: finished pictures, their files (small ones in few colours), and how far two are apart
//! - [`Camera`]: from where; [`Camera::turntable`] walks around
//! - [`Strands`], [`SolidMesh`], [`Scene`]: what is drawn; [`Shading`] and [`ColourBy`]: how hair looks
//! - [`Video`]: frames handed to `ffmpeg`, where that is installed
//! - `Renderer` (feature `gpu`): draws a scene on a Vulkan driver, that of a graphics card or Mesa's for the processor
//! - [`RenderProcess`]: the same in a program of its own, `hair-draw`, for programs built without it
//!
//! Feature `gpu` (off by default: it takes minutes to build) brings the renderer; all else is there without it.
//! The same scene drawn twice by one driver gives the same bytes. Centimetres; colours are linear red, green, blue in 0..1.
//!
//! ```
//! use hair_viewer::{Camera, ColourBy, Scene, Strands};
//!
//! let strand: Vec<[f32; 3]> = (0..25).map(|i| [0.0, -(i as f32), 0.0]).collect();
//! let mut scene = Scene::new(Camera::around([0.0, -12.0, 0.0], 60.0, 0.0, 320, 240));
//! scene.strands.push(Strands::new(&strand, 25, ColourBy::Hair(hair_viewer::BROWN)));
//! assert_eq!(scene.strands[0].n_strands(), 1);
//! ```

mod camera;
mod colour;
mod compare;
mod error;
#[cfg(feature = "gpu")]
mod gpu;
mod image;
mod palette;
mod process;
mod scene;
mod video;
mod wire;

pub use camera::{Camera, viewer_axes};
pub use colour::{ColourBy, guide_colour, heat_colour, to_srgb};
pub use compare::psnr;
pub use error::Error;
#[cfg(feature = "gpu")]
pub use gpu::Renderer;
pub use image::{Image, contact_sheet};
pub use process::{RenderProcess, serve};
pub use scene::{BLONDE, BROWN, Curve, HORN, SKIN, Scene, Shading, SolidMesh, Strands};
pub use video::Video;
