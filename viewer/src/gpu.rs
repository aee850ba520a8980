//! The renderer: a scene drawn by a Vulkan driver, that of a graphics card or Mesa's for the processor.
//!
//! Passes, in order: maps of light (solids, first hair, layers of opacity) for each of three lights; solids; then hair in
//! batches, first its curves coloured point by point, then ribbons, four samples a drawn pixel; last the mean of all
//! samples. Nothing is left to chance and blending keeps the order of drawing: two pictures of one scene by one driver are
//! the same bytes. Colouring is done per point of a curve, not per fragment: a head of hair has far more
//! fragments than points.

mod device;
mod draw;
mod lights;
mod pipelines;
mod strands;

use crate::error::Error;
use crate::image::Image;
use crate::scene::Scene;
use pipelines::Pipelines;

/// A driver ready to draw. Making one takes a while (shaders are compiled); drawing with it does not change it.
pub struct Renderer {
    device: wgpu::Device,
    queue: wgpu::Queue,
    adapter: String,
    pipelines: Pipelines,
}

impl Renderer {
    /// Looks for a driver and prepares it. A graphics card comes before the processor; the environment variable
    /// `WGPU_ADAPTER_NAME` picks one by a part of its name.
    ///
    /// # Errors
    /// [`Error::NoDriver`] says what to install.
    pub fn new() -> Result<Self, Error> {
        let (device, queue, adapter) = device::open()?;
        let pipelines = Pipelines::new(&device);
        let renderer = Self { device, queue, adapter, pipelines };
        renderer.guarded(|| Ok(()))?;
        Ok(renderer)
    }

    /// What draws, as it names itself.
    pub fn adapter(&self) -> &str {
        &self.adapter
    }

    /// Draws a scene.
    ///
    /// # Errors
    /// Arrays whose lengths do not fit each other, numbers without sense, more than the driver can hold.
    pub fn picture(&self, scene: &Scene) -> Result<Image, Error> {
        scene.check()?;
        self.guarded(|| draw::picture(self, scene))
    }

    /// Runs `work` and turns what the driver complains of meanwhile into an error.
    fn guarded<T>(&self, work: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let misuse = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let result = work();
        let complaint = pollster::block_on(misuse.pop()).or(pollster::block_on(memory.pop()));
        match complaint {
            Some(error) => Err(self.failed(error.to_string())),
            None => result,
        }
    }

    fn failed(&self, reason: String) -> Error {
        Error::Driver { adapter: self.adapter.clone(), reason }
    }
}
