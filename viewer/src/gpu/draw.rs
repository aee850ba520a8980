//! One picture: what is uploaded, the passes in their order, and the way back.

use super::Renderer;
use super::lights::{Extents, MAP_SIZE, N_LIGHTS};
use super::pipelines::{COLOUR, DEPTH, OPACITY, PICTURE, RIBBON_CORNER, SAMPLES};
use super::strands::{Hair, upload};
use crate::error::Error;
use crate::image::Image;
use crate::scene::Scene;
use nalgebra::Vector3;
use wgpu::{BindingResource, BufferUsages, TextureFormat, TextureUsages};

/// Points of curves held at a time: 40 MiB of corners, and no more workgroups than every driver takes in one row.
const MAX_POINTS: usize = 1 << 20;
/// Invocations of a workgroup, as in `hair.wgsl`.
const GROUP: u32 = 64;
/// Most memory for a picture's samples: a driver that runs out of it may end the program.
const MAX_SAMPLE_BYTES: u64 = 4 << 30;

struct Maps {
    solid_depth: wgpu::Texture,
    hair_depth: wgpu::Texture,
    opacity: wgpu::Texture,
}

/// The parts of one picture on the device.
struct Frame<'a> {
    device: &'a wgpu::Device,
    renderer: &'a Renderer,
    uniform: wgpu::Buffer,
    lights: Vec<wgpu::Buffer>,
    maps: Maps,
    solids: Option<(wgpu::Buffer, u32)>,
}

pub(super) fn picture(renderer: &Renderer, scene: &Scene) -> Result<Image, Error> {
    let device = &renderer.device;
    let (width, height) = (scene.camera.width as u32, scene.camera.height as u32);
    let (wide, high) = (u64::from(width) * scene.supersampling as u64, u64::from(height) * scene.supersampling as u64);
    let limit = u64::from(device.limits().max_texture_dimension_2d);
    if wide.max(high) > limit {
        return Err(Error::TooLarge {
            what: "the longer side of the picture, supersampled,",
            needed: wide.max(high),
            limit,
        });
    }
    // Colour and depth of each sample.
    let needed = wide * high * u64::from(SAMPLES) * (8 + 4);
    if needed > MAX_SAMPLE_BYTES {
        return Err(Error::TooLarge { what: "the samples of the picture (bytes)", needed, limit: MAX_SAMPLE_BYTES });
    }
    let surfaces: Vec<f32> = surfaces(scene);
    let extents = Extents::of(scene, surfaces.chunks_exact(9).map(|v| Vector3::new(v[0], v[1], v[2])));
    let hair: Vec<Hair> =
        scene.strands.iter().map(|s| upload(renderer, scene, s, &extents)).collect::<Result<_, _>>()?;
    let map = |format, usage| texture(device, [MAP_SIZE, MAP_SIZE, N_LIGHTS], 1, format, usage);
    let frame = Frame {
        device,
        renderer,
        uniform: buffer(renderer, bytemuck::cast_slice(&extents.frame(scene)), BufferUsages::UNIFORM),
        lights: (0..N_LIGHTS)
            .map(|k| buffer(renderer, bytemuck::cast_slice(&[k, 0, 0, 0]), BufferUsages::UNIFORM))
            .collect(),
        maps: Maps { solid_depth: map(DEPTH, DRAWN), hair_depth: map(DEPTH, DRAWN), opacity: map(OPACITY, DRAWN) },
        solids: (!surfaces.is_empty()).then(|| {
            let bytes = bytemuck::cast_slice(&surfaces);
            (buffer(renderer, bytes, BufferUsages::VERTEX), surfaces.len() as u32 / 9)
        }),
    };
    let size = [wide as u32, high as u32, 1];
    let colour = texture(device, size, SAMPLES, COLOUR, DRAWN).create_view(&wgpu::TextureViewDescriptor::default());
    let depth = texture(device, size, SAMPLES, DEPTH, TextureUsages::RENDER_ATTACHMENT)
        .create_view(&wgpu::TextureViewDescriptor::default());

    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    frame.draw_maps(&mut encoder, &hair);
    frame.draw_solids(&mut encoder, &colour, &depth);
    for h in &hair {
        frame.draw_hair(&mut encoder, h, &colour, &depth);
    }
    let target =
        texture(device, [width, height, 1], 1, PICTURE, TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC);
    frame.finish(&mut encoder, &colour, &target);
    read_back(renderer, encoder, &target, width, height)
}

const DRAWN: TextureUsages = TextureUsages::RENDER_ATTACHMENT.union(TextureUsages::TEXTURE_BINDING);

/// Corners of all triangles: position, normal, colour, nine numbers each.
fn surfaces(scene: &Scene) -> Vec<f32> {
    let mut out = Vec::new();
    for solid in &scene.solids {
        let placed = solid.placed();
        for &corner in solid.triangles.iter().flatten() {
            let [position, normal] = &placed[corner as usize];
            out.extend(position.iter().chain(normal.iter()).chain(&solid.colour));
        }
    }
    out
}

impl Frame<'_> {
    fn group(&self, layout: wgpu::BindGroupLayout, parts: &[(u32, BindingResource)]) -> wgpu::BindGroup {
        let entries: Vec<_> = parts
            .iter()
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding: *binding, resource: resource.clone() })
            .collect();
        self.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout: &layout, entries: &entries })
    }

    fn draw_maps(&self, encoder: &mut wgpu::CommandEncoder, hair: &[Hair]) {
        let stages = &self.renderer.pipelines;
        let uniforms: Vec<_> = hair.iter().map(|h| h.uniform(self.renderer, 0, h.n_strands)).collect();
        for (k, light) in self.lights.iter().enumerate() {
            let frame =
                |layout| self.group(layout, &[(0, self.uniform.as_entire_binding()), (1, light.as_entire_binding())]);
            {
                let view = layer(&self.maps.solid_depth, k);
                let mut pass = begin(encoder, None, Some((&view, true)));
                if let Some((vertices, n)) = &self.solids {
                    pass.set_pipeline(&stages.solid_in_map);
                    pass.set_bind_group(0, &frame(stages.solid_in_map.get_bind_group_layout(0)), &[]);
                    pass.set_vertex_buffer(0, vertices.slice(..));
                    pass.draw(0..*n, 0..1);
                }
            }
            let lines =
                |pass: &mut wgpu::RenderPass, stage: &wgpu::RenderPipeline, first: Option<&wgpu::TextureView>| {
                    pass.set_pipeline(stage);
                    for (h, uniform) in hair.iter().zip(&uniforms) {
                        let mut parts = vec![
                            (0, self.uniform.as_entire_binding()),
                            (1, light.as_entire_binding()),
                            (2, uniform.as_entire_binding()),
                            (3, h.positions.as_entire_binding()),
                        ];
                        parts.extend(first.map(|view| (7, BindingResource::TextureView(view))));
                        pass.set_bind_group(0, &self.group(stage.get_bind_group_layout(0), &parts), &[]);
                        pass.draw(0..h.n_particles, 0..h.n_strands.div_ceil(h.stride));
                    }
                };
            {
                let view = layer(&self.maps.hair_depth, k);
                let mut pass = begin(encoder, None, Some((&view, true)));
                lines(&mut pass, &stages.hair_in_map, None);
            }
            let (view, first) = (layer(&self.maps.opacity, k), layers(&self.maps.hair_depth));
            let mut pass = begin(encoder, Some((&view, true)), None);
            lines(&mut pass, &stages.opacity, Some(&first));
        }
    }

    fn draw_solids(&self, encoder: &mut wgpu::CommandEncoder, colour: &wgpu::TextureView, depth: &wgpu::TextureView) {
        let stage = &self.renderer.pipelines.solids;
        let mut pass = begin(encoder, Some((colour, true)), Some((depth, true)));
        let Some((vertices, n)) = &self.solids else { return };
        let maps = self.maps.views();
        let mut parts = vec![(0, self.uniform.as_entire_binding())];
        parts.extend(maps.iter().enumerate().map(|(k, view)| (6 + k as u32, BindingResource::TextureView(view))));
        pass.set_pipeline(stage);
        pass.set_bind_group(0, &self.group(stage.get_bind_group_layout(0), &parts), &[]);
        pass.set_vertex_buffer(0, vertices.slice(..));
        pass.draw(0..*n, 0..1);
    }

    fn draw_hair(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        hair: &Hair,
        colour: &wgpu::TextureView,
        depth: &wgpu::TextureView,
    ) {
        let stages = &self.renderer.pipelines;
        let n_points = hair.n_points();
        let batch = (MAX_POINTS as u32 / n_points).max(1);
        let corners_per_strand = 2 * n_points + 2;
        let corners = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("corners"),
            size: RIBBON_CORNER * u64::from(corners_per_strand) * u64::from(batch.min(hair.n_strands).max(1)),
            usage: BufferUsages::STORAGE | BufferUsages::VERTEX,
            mapped_at_creation: false,
        });
        let maps = self.maps.views();
        for first in (0..hair.n_strands).step_by(batch as usize) {
            let count = batch.min(hair.n_strands - first);
            let uniform = hair.uniform(self.renderer, first, count);
            let mut parts = vec![
                (0, self.uniform.as_entire_binding()),
                (2, uniform.as_entire_binding()),
                (3, hair.positions.as_entire_binding()),
                (4, hair.colours.as_entire_binding()),
                (5, corners.as_entire_binding()),
                (10, hair.order.as_entire_binding()),
            ];
            parts.extend(maps.iter().enumerate().map(|(k, view)| (6 + k as u32, BindingResource::TextureView(view))));
            {
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
                pass.set_pipeline(&stages.curves);
                pass.set_bind_group(0, &self.group(stages.curves.get_bind_group_layout(0), &parts), &[]);
                pass.dispatch_workgroups((count * n_points).div_ceil(GROUP), 1, 1);
            }
            let mut pass = begin(encoder, Some((colour, false)), Some((depth, false)));
            pass.set_pipeline(&stages.ribbons);
            pass.set_vertex_buffer(0, corners.slice(..));
            pass.draw(0..count * corners_per_strand, 0..1);
        }
    }

    fn finish(&self, encoder: &mut wgpu::CommandEncoder, colour: &wgpu::TextureView, target: &wgpu::Texture) {
        let stage = &self.renderer.pipelines.finish;
        let view = target.create_view(&wgpu::TextureViewDescriptor::default());
        let mut pass = begin(encoder, Some((&view, true)), None);
        let parts = [(0, self.uniform.as_entire_binding()), (9, BindingResource::TextureView(colour))];
        pass.set_pipeline(stage);
        pass.set_bind_group(0, &self.group(stage.get_bind_group_layout(0), &parts), &[]);
        pass.draw(0..3, 0..1);
    }
}

impl Maps {
    /// All lights of each map, in the order of their bindings.
    fn views(&self) -> [wgpu::TextureView; 3] {
        [layers(&self.solid_depth), layers(&self.hair_depth), layers(&self.opacity)]
    }
}

/// All layers of a texture.
fn layers(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..wgpu::TextureViewDescriptor::default()
    })
}

/// One layer of a texture, to draw on.
fn layer(texture: &wgpu::Texture, k: usize) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2),
        base_array_layer: k as u32,
        array_layer_count: Some(1),
        ..wgpu::TextureViewDescriptor::default()
    })
}

/// Begins to draw on a colour and a depth; each is wiped first or not.
fn begin<'e>(
    encoder: &'e mut wgpu::CommandEncoder,
    colour: Option<(&wgpu::TextureView, bool)>,
    depth: Option<(&wgpu::TextureView, bool)>,
) -> wgpu::RenderPass<'e> {
    let store = wgpu::StoreOp::Store;
    let attachments = colour.map(|(view, wipe)| {
        let load = if wipe { wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT) } else { wgpu::LoadOp::Load };
        let ops = wgpu::Operations { load, store };
        [Some(wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops })]
    });
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: None,
        color_attachments: attachments.as_ref().map_or(&[], |a| a),
        depth_stencil_attachment: depth.map(|(view, wipe)| {
            let load = if wipe { wgpu::LoadOp::Clear(1.0) } else { wgpu::LoadOp::Load };
            let depth_ops = Some(wgpu::Operations { load, store });
            wgpu::RenderPassDepthStencilAttachment { view, depth_ops, stencil_ops: None }
        }),
        timestamp_writes: None,
        occlusion_query_set: None,
        multiview_mask: None,
    })
}

/// A buffer of these bytes.
pub(super) fn buffer(renderer: &Renderer, bytes: &[u8], usage: BufferUsages) -> wgpu::Buffer {
    let buffer = renderer.device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: bytes.len() as u64,
        usage: usage | BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    renderer.queue.write_buffer(&buffer, 0, bytes);
    buffer
}

fn texture(
    device: &wgpu::Device,
    [width, height, depth_or_array_layers]: [u32; 3],
    sample_count: u32,
    format: TextureFormat,
    usage: TextureUsages,
) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width, height, depth_or_array_layers },
        mip_level_count: 1,
        sample_count,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    })
}

/// Runs what is recorded and fetches the picture.
fn read_back(
    renderer: &Renderer,
    mut encoder: wgpu::CommandEncoder,
    picture: &wgpu::Texture,
    width: u32,
    height: u32,
) -> Result<Image, Error> {
    let row = (4 * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let size = u64::from(row) * u64::from(height);
    let back = renderer.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("picture"),
        size,
        usage: BufferUsages::COPY_DST | BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    encoder.copy_texture_to_buffer(
        picture.as_image_copy(),
        wgpu::TexelCopyBufferInfo {
            buffer: &back,
            layout: wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None },
        },
        picture.size(),
    );
    renderer.queue.submit([encoder.finish()]);
    let (done, told) = std::sync::mpsc::channel();
    back.map_async(wgpu::MapMode::Read, .., move |result| {
        // The receiver waits below; it cannot be gone.
        let _ = done.send(result);
    });
    renderer.device.poll(wgpu::PollType::wait_indefinitely()).map_err(|e| renderer.failed(e.to_string()))?;
    let mapped = told.recv().map_err(|e| renderer.failed(e.to_string()))?;
    mapped.map_err(|e| renderer.failed(e.to_string()))?;
    let bytes = back.get_mapped_range(..).map_err(|e| renderer.failed(e.to_string()))?;
    let mut rgb = Vec::with_capacity(3 * (width * height) as usize);
    for line in bytes.chunks_exact(row as usize) {
        for pixel in line[..4 * width as usize].chunks_exact(4) {
            rgb.extend_from_slice(&pixel[..3]);
        }
    }
    drop(bytes);
    back.unmap();
    Ok(Image { width: width as usize, height: height as usize, rgb })
}
