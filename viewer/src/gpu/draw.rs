//! One picture: what is uploaded, the passes in their order, and the way back.

use super::Renderer;
use super::lights::{Extents, MAP_SIZE, N_LIGHTS};
use super::pipelines::{COLOUR, DEPTH, OPACITY, PICTURE, RIBBON_CORNER, SAMPLES};
use crate::error::Error;
use crate::image::Image;
use crate::scene::{Curve, Scene, Strands};
use nalgebra::Vector3;
use wgpu::{BindingResource, BufferUsages, TextureFormat, TextureUsages};

/// Points of curves held at a time: 40 MiB of corners, and no more workgroups than every driver takes in one row.
const MAX_POINTS: usize = 1 << 20;
/// Invocations of a workgroup, as in `hair.wgsl`.
const GROUP: u32 = 64;
/// Lines drawn into each map of light; of more strands every second, third, ... stands for its neighbours.
const MAX_SHADOW_LINES: usize = 12_000;
/// Distance allowed between a curve and the pieces drawn for it, drawn pixels.
const SAG_PIXELS: f32 = 0.35;
/// Longest piece, drawn pixels: colours are interpolated along it.
const PIECE_PIXELS: f32 = 40.0;
/// Most pieces of a segment.
const MAX_PIECES: f32 = 8.0;

/// Most memory for a picture's samples: a driver that runs out of it may end the program.
const MAX_SAMPLE_BYTES: u64 = 4 << 30;

/// Where strands go that are not drawn: far off, all particles in one place, a ribbon without area.
const NOWHERE: [f32; 3] = [3e6; 3];

/// Strands on the device.
struct Hair {
    positions: wgpu::Buffer,
    colours: wgpu::Buffer,
    order: wgpu::Buffer,
    n_particles: u32,
    n_strands: u32,
    pieces: u32,
    stride: u32,
    flags: u32,
    base: [f32; 3],
    width: f32,
    line_opacity: f32,
    curve: Curve,
}

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

fn upload(renderer: &Renderer, scene: &Scene, strands: &Strands, extents: &Extents) -> Result<Hair, Error> {
    let (n, n_strands) = (strands.n_particles, strands.n_strands());
    let mut positions = strands.positions.to_vec();
    for strand in positions.chunks_exact_mut(n) {
        if !strand.iter().flatten().all(|x| x.is_finite()) {
            strand.fill(NOWHERE);
        }
    }
    let colours = strands.colour.colours(n_strands, n)?;
    let limit = renderer.device.limits().max_storage_buffer_binding_size;
    let needed = 12 * positions.len() as u64;
    if needed > limit {
        return Err(Error::TooLarge { what: "the strands' positions (bytes)", needed, limit });
    }
    let packed: Vec<u32> = colours.iter().map(packed).collect();
    let per_particle = colours.len() > 1;
    let flags = u32::from(per_particle) + 2 * u32::from(strands.colour.is_measure());
    let stride = n_strands.div_ceil(MAX_SHADOW_LINES).max(1) as u32;
    Ok(Hair {
        // A buffer holds something, even for no strands.
        positions: buffer(renderer, at_least(bytemuck::cast_slice(&positions)), BufferUsages::STORAGE),
        colours: buffer(renderer, at_least(bytemuck::cast_slice(&packed)), BufferUsages::STORAGE),
        order: buffer(renderer, at_least(bytemuck::cast_slice(&nearest_first(strands, scene))), BufferUsages::STORAGE),
        n_particles: n as u32,
        n_strands: n_strands as u32,
        pieces: pieces(scene, strands),
        stride,
        flags,
        base: colours.first().copied().unwrap_or_default(),
        width: strands.width_cm,
        line_opacity: extents.line_opacity(strands.width_cm, stride),
        curve: strands.curve,
    })
}

/// Strands by the distance of their middles from the eye: what hides others is drawn before them.
fn nearest_first(strands: &Strands, scene: &Scene) -> Vec<u32> {
    let eye = Vector3::from(scene.camera.eye);
    let n = strands.n_particles;
    let mut order: Vec<(f32, u32)> = (0..strands.n_strands())
        .map(|s| ((Vector3::from(strands.positions[s * n + n / 2]) - eye).norm_squared(), s as u32))
        .collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    order.into_iter().map(|(_, s)| s).collect()
}

fn at_least(bytes: &[u8]) -> &[u8] {
    if bytes.is_empty() { &[0; 16] } else { bytes }
}

/// Three times ten bits, as `packed` in `hair.wgsl`.
fn packed(colour: &[f32; 3]) -> u32 {
    let q = colour.map(|c| ((c.clamp(0.0, 4.0) * 0.25).sqrt() * 1023.0 + 0.5) as u32);
    q[0] | q[1] << 10 | q[2] << 20
}

/// Pieces of a segment of a curve, enough for nineteen segments in twenty: none long on the screen, none off the curve.
fn pieces(scene: &Scene, strands: &Strands) -> u32 {
    let eye = Vector3::from(scene.camera.eye);
    let pixel = scene.camera.pixel_at_one() / scene.supersampling as f32;
    // Some hundred strands tell for all.
    let step = (strands.n_strands() / 256).max(1);
    let mut needed = Vec::new();
    for strand in strands.positions.chunks_exact(strands.n_particles).step_by(step) {
        for three in strand.windows(3) {
            let [a, b, c] = [0, 1, 2].map(|k| Vector3::from(three[k]));
            let (into, out) = (b - a, c - b);
            let length = into.norm().max(out.norm()) / (pixel * (b - eye).norm()).max(1e-9);
            // A chord of an arc of `bend` radian is off it by an eighth of bend times length; both shrink with the pieces.
            let sag = (into.angle(&out) * length / (8.0 * SAG_PIXELS)).sqrt();
            needed.push(sag.max(length / PIECE_PIXELS));
        }
    }
    needed.retain(|x| x.is_finite());
    needed.sort_by(f32::total_cmp);
    let most = needed.get(needed.len() * 19 / 20).copied().unwrap_or(1.0);
    most.ceil().clamp(1.0, MAX_PIECES) as u32
}

impl Hair {
    fn n_points(&self) -> u32 {
        (self.n_particles - 1) * self.pieces + 1
    }

    /// `Hair` of `common.wgsl` for `count` strands from `first` on.
    fn uniform(&self, renderer: &Renderer, first: u32, count: u32) -> wgpu::Buffer {
        let curve = u32::from(self.curve == Curve::Through);
        let f = f32::to_bits;
        let words = [
            [self.n_particles, self.pieces, self.n_points(), count],
            [first, self.stride, curve, self.flags],
            [f(self.width), f(self.line_opacity), 0, 0],
            [f(self.base[0]), f(self.base[1]), f(self.base[2]), f(1.0)],
        ];
        buffer(renderer, bytemuck::cast_slice(&words), BufferUsages::UNIFORM)
    }
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

fn buffer(renderer: &Renderer, bytes: &[u8], usage: BufferUsages) -> wgpu::Buffer {
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
