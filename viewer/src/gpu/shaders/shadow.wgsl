// Maps of light: how deep the first solid and the first hair lie, and how much hair there is behind the first, in layers
// (deep opacity maps, Yuksel and Keyser 2008). Hair is drawn as lines through its particles.

fn map_clip(point: vec3<f32>) -> vec4<f32> {
    let light = frame.lights[light_index.x];
    let q = light.map_from_world * vec4<f32>(point, 1.0);
    return vec4<f32>(2.0 * q.x / MAP_SIZE - 1.0, 1.0 - 2.0 * q.y / MAP_SIZE, q.z / light.toward.w, 1.0);
}

@vertex
fn solid_in_map(@location(0) point: vec3<f32>) -> @builtin(position) vec4<f32> {
    return map_clip(point);
}

@vertex
fn hair_in_map(@builtin(vertex_index) particle: u32, @builtin(instance_index) n: u32) -> @builtin(position) vec4<f32> {
    return map_clip(position(n * hair.shadow_stride, particle));
}

@fragment
fn add_opacity(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let first = textureLoad(hair_depth, vec2<i32>(at.xy), light_index.x, 0);
    let behind = (at.z - first) * frame.lights[light_index.x].toward.w;
    // A layer holds all hair from the first up to its own far end; the last holds all there is.
    let held = vec4<f32>(f32(behind < frame.layers.x), f32(behind < frame.layers.y), f32(behind < frame.layers.z), 1.0);
    return hair.line_opacity * held;
}
