//! Finding a driver: any Vulkan device that draws, the fastest kind first, the processor last.

use crate::error::Error;

/// Opens the best device there is, with all it allows for buffers and pictures, and gives its name.
pub(super) fn open() -> Result<(wgpu::Device, wgpu::Queue, String), Error> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        ..wgpu::InstanceDescriptor::new_without_display_handle_from_env()
    });
    let mut adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::VULKAN));
    let wanted = std::env::var("WGPU_ADAPTER_NAME").unwrap_or_default().to_lowercase();
    adapters.retain(|a| a.get_info().name.to_lowercase().contains(&wanted));
    // Stable: of equals the driver's own first stays first.
    adapters.sort_by_key(|a| rank(a.get_info().device_type));
    let Some(adapter) = adapters.first() else {
        let which = if wanted.is_empty() { String::new() } else { format!(" named {wanted:?}") };
        return Err(Error::NoDriver { reason: format!("the Vulkan loader or a device{which} is missing") });
    };
    let name = adapter.get_info().name;
    let offered = adapter.limits();
    let required_limits = wgpu::Limits {
        max_buffer_size: offered.max_buffer_size,
        max_storage_buffer_binding_size: offered.max_storage_buffer_binding_size,
        max_texture_dimension_2d: offered.max_texture_dimension_2d,
        ..wgpu::Limits::default()
    };
    let wanted = wgpu::DeviceDescriptor { label: Some("hair"), required_limits, ..wgpu::DeviceDescriptor::default() };
    let (device, queue) = pollster::block_on(adapter.request_device(&wanted))
        .map_err(|error| Error::Driver { adapter: name.clone(), reason: error.to_string() })?;
    Ok((device, queue, name))
}

fn rank(kind: wgpu::DeviceType) -> u8 {
    match kind {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    }
}
