//! Who draws: the renderer where there is a Vulkan driver, else the plain rasteriser, which says so.
//!
//! The renderer takes minutes to build and is a program of its own (`hair-draw`), built by cargo when first asked for; without a
//! driver's manifest on this machine it is not asked for.

use crate::progress::Bars;
use crate::workspace_root;
use anyhow::{Result, bail};
use hair_bench::picture::render;
use hair_bench::world::World;
use hair_viewer::{BROWN, Camera, ColourBy, HORN, Image, RenderProcess, SKIN, Scene, SolidMesh, Strands};
use io_formats::mesh::TriMesh;
use nalgebra::Isometry3;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What to do about it.
const INSTALL: &str = "a graphics card's driver, or Mesa's for the processor alone (Debian: mesa-vulkan-drivers libvulkan1), \
                       gives shaded pictures";

/// Whatever draws.
pub struct Painter {
    renderer: Option<RenderProcess>,
    /// What draws, in words.
    name: String,
    note: Option<String>,
}

impl Painter {
    /// The renderer, or else the plain rasteriser.
    pub fn best(bars: &Bars) -> Self {
        if !has_driver() {
            return Self::without("there is no Vulkan driver");
        }
        match Self::shaded(bars) {
            Ok(painter) => painter,
            Err(error) => Self::without(&format!("{error:#}")),
        }
    }

    /// The renderer.
    ///
    /// # Errors
    /// It cannot be built, or finds no driver.
    pub fn shaded(bars: &Bars) -> Result<Self> {
        let renderer = start(bars)?;
        let name = format!("the renderer, on {}", renderer.adapter());
        Ok(Self { renderer: Some(renderer), name, note: None })
    }

    /// The plain rasteriser, by choice.
    pub fn plain() -> Self {
        Self { renderer: None, name: "the plain rasteriser".to_owned(), note: None }
    }

    fn without(why: &str) -> Self {
        Self { note: Some(format!("pictures are drawn by the plain rasteriser: {why}; {INSTALL}")), ..Self::plain() }
    }

    /// What draws, in words.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Why pictures are plainer than they could be, if they are.
    pub fn note(&self) -> Option<&str> {
        self.note.as_deref()
    }

    /// Draws a scene.
    ///
    /// # Errors
    /// A scene that cannot be drawn, a driver that fails.
    pub fn draw(&mut self, scene: &Scene) -> Result<Image> {
        Ok(match &mut self.renderer {
            Some(renderer) => renderer.picture(scene)?,
            None => render(scene)?,
        })
    }

    /// The hair of a world at time `t` from a place, with the time in its corner. Strands are brown, or have these colours.
    ///
    /// # Errors
    /// As [`Self::draw`].
    pub fn picture(
        &mut self,
        world: &World,
        t: f64,
        positions: &[[f32; 3]],
        colours: Option<&[[f32; 3]]>,
        camera: Camera,
    ) -> Result<Image> {
        let n = world.groom.n_particles;
        if positions.len() < n || !positions.len().is_multiple_of(n) {
            bail!("{} positions are not strands of {n} particles", positions.len());
        }
        let mut scene = Scene::new(camera);
        let colour = colours.map_or(ColourBy::Hair(BROWN), ColourBy::Strand);
        scene.strands.push(Strands::new(positions, n, colour));
        scene.solids = solids(world, t, [SKIN, HORN]);
        let mut image = self.draw(&scene)?;
        image.draw_time(t);
        Ok(image)
    }
}

/// Starts the program that draws; cargo builds it first if it has to.
///
/// # Errors
/// It cannot be built, or finds no driver.
pub fn start(bars: &Bars) -> Result<RenderProcess> {
    bars.note("starting the renderer; cargo builds it the first time, which takes minutes");
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(cargo);
    command
        .args(["run", "--release", "--package", "hair-viewer", "--features", "gpu", "--bin", "hair-draw"])
        .current_dir(workspace_root());
    Ok(RenderProcess::start(command)?)
}

/// Whether some driver has left its manifest where Vulkan's loader looks, or the environment names one.
fn has_driver() -> bool {
    if ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"].iter().any(|name| std::env::var_os(name).is_some_and(|v| !v.is_empty()))
    {
        return true;
    }
    // Elsewhere than on Linux drivers are found in other ways: the renderer itself will say.
    !cfg!(target_os = "linux") || manifest_folders().iter().any(|folder| holds_manifest(folder))
}

fn manifest_folders() -> Vec<PathBuf> {
    let mut bases: Vec<PathBuf> =
        ["/etc", "/usr/share", "/usr/local/share", "/usr/local/etc"].map(PathBuf::from).to_vec();
    for name in ["XDG_DATA_DIRS", "XDG_CONFIG_DIRS"] {
        bases.extend(std::env::var_os(name).iter().flat_map(|list| std::env::split_paths(list).collect::<Vec<_>>()));
    }
    bases.extend(std::env::var_os("HOME").map(|home| Path::new(&home).join(".local/share")));
    bases.into_iter().map(|base| base.join("vulkan/icd.d")).collect()
}

fn holds_manifest(folder: &Path) -> bool {
    std::fs::read_dir(folder)
        .is_ok_and(|entries| entries.flatten().any(|e| e.path().extension().is_some_and(|x| x == "json")))
}

/// The scene's camera.
pub fn camera(world: &World) -> Camera {
    let camera = &world.scene.camera;
    Camera {
        eye: camera.eye_cm.map(|x| x as f32),
        target: camera.target_cm.map(|x| x as f32),
        vertical_fov: camera.vertical_fov_deg.to_radians() as f32,
        width: camera.width as usize,
        height: camera.height as usize,
    }
}

/// The same view in another height.
pub fn sized(camera: Camera, height: Option<usize>) -> Camera {
    let Some(height) = height else { return camera };
    Camera { width: (camera.width * height).div_ceil(camera.height.max(1)), height, ..camera }
}

/// The scene's solids at time `t`, in a colour for the head and one for all others.
pub fn solids(world: &World, t: f64, [head, others]: [[f32; 3]; 2]) -> Vec<SolidMesh<'_>> {
    fn place(mesh: &TriMesh, pose: Isometry3<f64>, colour: [f32; 3]) -> SolidMesh<'_> {
        let TriMesh { vertices, triangles } = mesh;
        SolidMesh { vertices, triangles, world_from_solid: pose.cast(), colour }
    }
    let mut out = vec![place(&world.head_mesh, world.world_from_head(t), head)];
    out.extend(world.solid_meshes.iter().zip(world.world_from_solids(t)).map(|(mesh, pose)| place(mesh, pose, others)));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_height_keeps_the_shape_of_the_view() {
        let camera = Camera::around([0.0; 3], 40.0, 0.0, 640, 480);
        assert_eq!(sized(camera, None), camera);
        let small = sized(camera, Some(120));
        assert_eq!((small.width, small.height, small.eye), (160, 120, camera.eye));
    }

    #[test]
    fn a_folder_holds_a_driver_only_with_a_manifest_in_it() {
        let dir = tempfile::tempdir().unwrap();
        assert!(!holds_manifest(dir.path()) && !holds_manifest(&dir.path().join("none")));
        std::fs::write(dir.path().join("readme.txt"), "").unwrap();
        assert!(!holds_manifest(dir.path()));
        std::fs::write(dir.path().join("driver.json"), "{}").unwrap();
        assert!(holds_manifest(dir.path()));
    }
}
