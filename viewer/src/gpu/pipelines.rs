//! What the driver is asked to do at each stage, compiled once.
//!
//! All shaders are one module, their bindings one list: each stage uses those it names, and its layout follows from that.

use std::borrow::Cow;
use wgpu::{PrimitiveTopology, TextureFormat};

/// Of the samples of a picture in the making.
pub(super) const COLOUR: TextureFormat = TextureFormat::Rgba16Float;
/// Of all depths.
pub(super) const DEPTH: TextureFormat = TextureFormat::Depth32Float;
/// Of the layers of hair seen from a light.
pub(super) const OPACITY: TextureFormat = TextureFormat::Rgba16Float;
/// Of the finished picture.
pub(super) const PICTURE: TextureFormat = TextureFormat::Rgba8Unorm;
/// Samples of a drawn pixel.
pub(super) const SAMPLES: u32 = 4;
/// Bytes of a corner of a solid's triangle: position, normal, colour.
const SOLID_CORNER: u64 = 36;
/// Bytes of a corner of a ribbon: place on the screen, colour.
pub(super) const RIBBON_CORNER: u64 = 20;

pub(super) struct Pipelines {
    pub solid_in_map: wgpu::RenderPipeline,
    pub hair_in_map: wgpu::RenderPipeline,
    pub opacity: wgpu::RenderPipeline,
    pub curves: wgpu::ComputePipeline,
    pub ribbons: wgpu::RenderPipeline,
    pub solids: wgpu::RenderPipeline,
    pub finish: wgpu::RenderPipeline,
}

/// One stage that draws.
struct Stage<'a> {
    vertex: &'a str,
    vertex_buffer: Option<(u64, &'a [wgpu::VertexAttribute])>,
    topology: PrimitiveTopology,
    fragment: Option<(&'a str, TextureFormat)>,
    adds: bool,
    has_depth: bool,
    samples: u32,
}

impl Pipelines {
    pub fn new(device: &wgpu::Device) -> Self {
        let source = concat!(
            include_str!("shaders/common.wgsl"),
            include_str!("shaders/shadow.wgsl"),
            include_str!("shaders/hair.wgsl"),
            include_str!("shaders/solid.wgsl"),
            include_str!("shaders/finish.wgsl"),
        );
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("hair"),
            source: wgpu::ShaderSource::Wgsl(Cow::Borrowed(source)),
        });
        let position = wgpu::vertex_attr_array![0 => Float32x3];
        let surface = wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3, 2 => Float32x3];
        let map = Stage {
            vertex: "solid_in_map",
            vertex_buffer: Some((SOLID_CORNER, &position)),
            topology: PrimitiveTopology::TriangleList,
            fragment: None,
            adds: false,
            has_depth: true,
            samples: 1,
        };
        let lines = Stage { vertex: "hair_in_map", vertex_buffer: None, topology: PrimitiveTopology::LineStrip, ..map };
        let opacity = Stage { fragment: Some(("add_opacity", OPACITY)), adds: true, has_depth: false, ..lines };
        let solids = Stage {
            vertex: "solid",
            vertex_buffer: Some((SOLID_CORNER, &surface)),
            fragment: Some(("solid_colour", COLOUR)),
            samples: SAMPLES,
            ..map
        };
        let corner = wgpu::vertex_attr_array![0 => Float32x4, 1 => Unorm10_10_10_2];
        let ribbons = Stage {
            vertex: "ribbon",
            vertex_buffer: Some((RIBBON_CORNER, &corner)),
            topology: PrimitiveTopology::TriangleStrip,
            fragment: Some(("ribbon_colour", COLOUR)),
            ..solids
        };
        let finish = Stage {
            vertex: "whole",
            vertex_buffer: None,
            fragment: Some(("finish", PICTURE)),
            has_depth: false,
            ..map
        };
        Self {
            solid_in_map: map.build(device, &module),
            hair_in_map: lines.build(device, &module),
            opacity: opacity.build(device, &module),
            curves: device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some("curves"),
                layout: None,
                module: &module,
                entry_point: Some("curves"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: None,
            }),
            ribbons: ribbons.build(device, &module),
            solids: solids.build(device, &module),
            finish: finish.build(device, &module),
        }
    }
}

impl Stage<'_> {
    fn build(&self, device: &wgpu::Device, module: &wgpu::ShaderModule) -> wgpu::RenderPipeline {
        let compilation_options = wgpu::PipelineCompilationOptions::default();
        let sum = wgpu::BlendComponent {
            src_factor: wgpu::BlendFactor::One,
            dst_factor: wgpu::BlendFactor::One,
            operation: wgpu::BlendOperation::Add,
        };
        let buffers = self.vertex_buffer.map(|(array_stride, attributes)| {
            [Some(wgpu::VertexBufferLayout { array_stride, step_mode: wgpu::VertexStepMode::Vertex, attributes })]
        });
        let targets = self.fragment.map(|(_, format)| {
            [Some(wgpu::ColorTargetState {
                format,
                blend: self.adds.then_some(wgpu::BlendState { color: sum, alpha: sum }),
                write_mask: wgpu::ColorWrites::ALL,
            })]
        });
        device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(self.vertex),
            layout: None,
            vertex: wgpu::VertexState {
                module,
                entry_point: Some(self.vertex),
                compilation_options: compilation_options.clone(),
                buffers: buffers.as_ref().map_or(&[], |b| b),
            },
            primitive: wgpu::PrimitiveState { topology: self.topology, ..wgpu::PrimitiveState::default() },
            depth_stencil: self.has_depth.then(|| wgpu::DepthStencilState {
                format: DEPTH,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Less),
                stencil: wgpu::StencilState::default(),
                bias: wgpu::DepthBiasState::default(),
            }),
            multisample: wgpu::MultisampleState { count: self.samples, ..wgpu::MultisampleState::default() },
            fragment: self.fragment.zip(targets.as_ref()).map(|((entry, _), targets)| wgpu::FragmentState {
                module,
                entry_point: Some(entry),
                compilation_options,
                targets,
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}
