// What all stages share: the frame, hair, the maps of light, and how much light comes through hair.

struct Light {
    // World to map: columns and rows in texels, depth in cm.
    map_from_world: mat4x4<f32>,
    // Unit vector to the light; depth of the map, cm.
    toward: vec4<f32>,
    colour: vec4<f32>,
}

struct Frame {
    clip_from_world: mat4x4<f32>,
    // Where the camera stands; width of a drawn pixel at 1 cm.
    eye: vec4<f32>,
    backdrop_top: vec4<f32>,
    backdrop_bottom: vec4<f32>,
    // Far ends of the opacity layers behind the first hair, cm.
    layers: vec4<f32>,
    // Whether colours are shown as they are; drawn pixels per pixel; width, height of the picture.
    info: vec4<f32>,
    lights: array<Light, 3>,
}

struct Hair {
    n_particles: u32,
    pieces: u32,
    n_points: u32,
    n_strands: u32,
    first_strand: u32,
    shadow_stride: u32,
    // 0 B-spline, 1 through the particles.
    curve: u32,
    // 1: a colour per particle; 2: colours are measures.
    flags: u32,
    width: f32,
    // Optical depth that one line adds to a texel.
    line_opacity: f32,
    unused_1: f32,
    unused_2: f32,
    base: vec4<f32>,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> light_index: vec4<u32>;
@group(0) @binding(2) var<uniform> hair: Hair;
@group(0) @binding(3) var<storage, read> positions: array<f32>;
@group(0) @binding(4) var<storage, read> colours: array<u32>;
// Corners of ribbons, five words each: place on the screen, colour.
@group(0) @binding(5) var<storage, read_write> corners: array<u32>;
// Strands in the order of drawing, nearest first.
@group(0) @binding(10) var<storage, read> order: array<u32>;
@group(0) @binding(6) var solid_depth: texture_depth_2d_array;
@group(0) @binding(7) var hair_depth: texture_depth_2d_array;
@group(0) @binding(8) var hair_opacity: texture_2d_array<f32>;
@group(0) @binding(9) var samples: texture_multisampled_2d<f32>;

const MAP_SIZE: f32 = 1024.0;

fn position(strand: u32, particle: u32) -> vec3<f32> {
    let at = 3u * (strand * hair.n_particles + particle);
    return vec3<f32>(positions[at], positions[at + 1u], positions[at + 2u]);
}

// A well mixed word for a word (the finaliser of MurmurHash3).
fn mixed(word: u32) -> u32 {
    var h = word;
    h = (h ^ (h >> 16u)) * 0x85ebca6bu;
    h = (h ^ (h >> 13u)) * 0xc2b2ae35u;
    return h ^ (h >> 16u);
}

fn share_of(word: u32) -> f32 {
    return f32(mixed(word) >> 8u) / 16777216.0;
}

// Optical depth of hair between the light and a point `behind` cm behind the first hair, from the layers of its texel.
fn depth_of_hair(behind: f32, opacity: vec4<f32>) -> f32 {
    let far = frame.layers;
    if behind <= 0.0 { return 0.0; }
    if behind < far.x { return opacity.x * behind / far.x; }
    if behind < far.y { return mix(opacity.x, opacity.y, (behind - far.x) / (far.y - far.x)); }
    if behind < far.z { return mix(opacity.y, opacity.z, (behind - far.y) / (far.z - far.y)); }
    return mix(opacity.z, opacity.w, min((behind - far.z) / (far.w - far.z), 1.0));
}

// Share of a light that comes through hair, and past solids, to a point: means over the four texels around it.
fn light_at(k: u32, point: vec3<f32>, hair_gap: f32, solid_gap: f32) -> vec2<f32> {
    let q = frame.lights[k].map_from_world * vec4<f32>(point, 1.0);
    let corner = clamp(q.xy - 0.5, vec2<f32>(0.0), vec2<f32>(MAP_SIZE - 2.0));
    let first = vec2<i32>(floor(corner));
    let t = corner - floor(corner);
    let range = frame.lights[k].toward.w;
    var sum = vec2<f32>(0.0);
    for (var n = 0; n < 4; n++) {
        let offset = vec2<i32>(n & 1, n >> 1);
        let texel = first + offset;
        let weight = select(1.0 - t.x, t.x, offset.x == 1) * select(1.0 - t.y, t.y, offset.y == 1);
        let behind = q.z - hair_gap - textureLoad(hair_depth, texel, k, 0) * range;
        let tau = depth_of_hair(behind, textureLoad(hair_opacity, texel, k, 0));
        let barrier = textureLoad(solid_depth, texel, k, 0) * range;
        sum += weight * vec2<f32>(exp(-tau), select(0.0, 1.0, q.z < barrier + solid_gap));
    }
    return sum;
}
