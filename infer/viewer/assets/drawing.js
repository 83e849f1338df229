"use strict";
// WebGL 2: skinned meshes (bone matrices in a float texture), thick lines and round points.
const SKIN = [`#version 300 es
precision highp float; precision highp sampler2D;
uniform mat4 uView; uniform sampler2D uBones; uniform vec3 uOffset; uniform float uStep;
layout(location=0) in vec3 aPlace; layout(location=1) in vec3 aNormal; layout(location=2) in vec2 aUv;
layout(location=3) in uvec4 aJoints; layout(location=4) in vec4 aWeights;
layout(location=5) in uvec4 aMoreJoints; layout(location=6) in vec4 aMoreWeights;
out vec3 vNormal; out vec2 vUv; out vec3 vWorld;
void follow(uint j, float w, vec4 p, inout vec3 place, inout vec3 n) {
  if (w == 0.0) return;
  vec4 a = texelFetch(uBones, ivec2(0, int(j)), 0), b = texelFetch(uBones, ivec2(1, int(j)), 0), c = texelFetch(uBones, ivec2(2, int(j)), 0);
  place += w * vec3(dot(a, p), dot(b, p), dot(c, p));
  n += w * vec3(dot(a.xyz, aNormal), dot(b.xyz, aNormal), dot(c.xyz, aNormal));
}
void main() {
  vec4 p = vec4(uOffset + uStep * aPlace, 1.0); vec3 place = vec3(0.0), n = vec3(0.0);
  for (int k = 0; k < 4; k++) follow(aJoints[k], aWeights[k], p, place, n);
  for (int k = 0; k < 4; k++) follow(aMoreJoints[k], aMoreWeights[k], p, place, n);
  vNormal = n; vUv = aUv; vWorld = place; gl_Position = uView * vec4(place, 1.0);
}`, `#version 300 es
precision highp float;
uniform vec4 uColour; uniform sampler2D uImage; uniform bool uTextured; uniform vec3 uEye;
in vec3 vNormal; in vec2 vUv; in vec3 vWorld; out vec4 colour;
void main() {
  vec3 n = normalize(vNormal + vec3(0.0, 0.0, 1e-6)), e = normalize(uEye - vWorld);
  if (dot(n, e) < 0.0) n = -n;
  vec4 base = vec4(pow(uColour.rgb, vec3(1.0 / 2.2)), uColour.a);
  if (uTextured) base *= texture(uImage, vUv);
  if (base.a < 0.3) discard;
  float light = 0.45 + 0.35 * max(0.0, dot(n, normalize(vec3(0.4, -0.5, 0.8)))) + 0.25 * max(0.0, dot(n, e));
  colour = vec4(base.rgb * light, 1.0);
}`];
const LINES = [`#version 300 es
precision highp float; uniform mat4 uView; uniform vec2 uSize; uniform float uWidth, uNear;
layout(location=0) in vec3 aFrom; layout(location=1) in vec3 aTo; layout(location=2) in vec2 aCorner; layout(location=3) in vec4 aColour;
out vec4 vColour;
vec4 before(vec4 a, vec4 b) { return a.w < uNear ? mix(a, b, (uNear - a.w) / (b.w - a.w)) : a; }
void main() {
  vec4 a = uView * vec4(aFrom, 1.0), b = uView * vec4(aTo, 1.0); vColour = aColour;
  if (a.w < uNear && b.w < uNear) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
  vec4 c = before(a, b), d = before(b, a);
  vec2 way = (d.xy / d.w - c.xy / c.w) * uSize; way /= max(length(way), 1e-4);
  vec4 p = aCorner.y < 0.5 ? c : d;
  p.xy += vec2(-way.y, way.x) * aCorner.x * uWidth / uSize * p.w; gl_Position = p;
}`, `#version 300 es
precision highp float; in vec4 vColour; out vec4 colour; void main() { colour = vColour; }`];
const POINTS = [`#version 300 es
precision highp float; uniform mat4 uView; uniform float uScale;
layout(location=0) in vec3 aPlace; layout(location=1) in vec4 aColour; layout(location=2) in float aSize;
out vec4 vColour; void main() { gl_Position = uView * vec4(aPlace, 1.0); gl_PointSize = aSize * uScale; vColour = aColour; }`,
`#version 300 es
precision highp float; in vec4 vColour; out vec4 colour;
void main() { if (length(gl_PointCoord - 0.5) > 0.5) discard; colour = vColour; }`];
const CORNERS = [[-1, 0], [1, 0], [1, 1], [-1, 0], [1, 1], [-1, 1]];

// Whether pictures are drawn without a graphics card: smooth edges then cost as much as all the rest.
function drawnInSoftware() {
  const gl = document.createElement("canvas").getContext("webgl2");
  if (!gl) return false;
  const named = gl.getExtension("WEBGL_debug_renderer_info");
  const name = String(gl.getParameter(named ? named.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}

class Painter {
  constructor(canvas, changed, smooth = true) {
    const gl = this.gl = canvas.getContext("webgl2", { antialias: smooth, alpha: false });
    if (!gl) throw new Error("This browser has no WebGL 2, which the view needs.");
    this.changed = changed;
    this.skin = this.program(SKIN); this.lines = this.program(LINES); this.points = this.program(POINTS);
    this.buffer = gl.createBuffer();
    this.blank = this.image(null);
    gl.enable(gl.DEPTH_TEST); gl.enable(gl.BLEND); gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  }
  program(sources) {
    const gl = this.gl, made = gl.createProgram();
    [gl.VERTEX_SHADER, gl.FRAGMENT_SHADER].forEach((kind, i) => {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, sources[i]); gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(made, shader);
    });
    gl.linkProgram(made);
    if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
    const at = {};
    for (let i = 0; i < gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS); i++) {
      const name = gl.getActiveUniform(made, i).name;
      at[name] = gl.getUniformLocation(made, name);
    }
    return { made, at };
  }
  image(source) {
    const gl = this.gl, texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array([255, 255, 255, 255]));
    if (source) {
      const picture = new Image();
      picture.onload = () => {
        gl.bindTexture(gl.TEXTURE_2D, texture);
        gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, picture);
        gl.generateMipmap(gl.TEXTURE_2D); this.changed();
      };
      picture.src = source;
    }
    return texture;
  }
  prepare(take) {
    const gl = this.gl;
    take.textures = take.materials.map((m) => m.image ? this.image(m.image) : null);
    for (const mesh of take.meshes) {
      mesh.binds = decode(mesh.bind, Float32Array);
      mesh.rows = new Float32Array(12 * mesh.used.length);
      mesh.texture = gl.createTexture();
      gl.bindTexture(gl.TEXTURE_2D, mesh.texture);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
      mesh.array = gl.createVertexArray(); gl.bindVertexArray(mesh.array);
      const put = (at, text, Kind, size, type, stride, offset, way) => {
        gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
        gl.bufferData(gl.ARRAY_BUFFER, decode(text, Kind), gl.STATIC_DRAW);
        this.attribute(at, size, type, stride, offset, way);
      };
      put(0, mesh.positions.data, Int16Array, 3, gl.SHORT, 6, 0);
      put(1, mesh.normals, Int8Array, 3, gl.BYTE, 4, 0, "norm");
      if (mesh.uvs) put(2, mesh.uvs, Float32Array, 2, gl.FLOAT, 8, 0);
      put(3, mesh.joints, Uint16Array, 4, gl.UNSIGNED_SHORT, 2 * mesh.width, 0, "whole");
      if (mesh.width > 4) this.attribute(5, 4, gl.UNSIGNED_SHORT, 16, 8, "whole");
      put(4, mesh.weights, Uint16Array, 4, gl.UNSIGNED_SHORT, 2 * mesh.width, 0, "norm");
      if (mesh.width > 4) this.attribute(6, 4, gl.UNSIGNED_SHORT, 16, 8, "norm");
      const triangles = decode(mesh.triangles, Uint32Array);
      mesh.size = triangles.length;
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, triangles, gl.STATIC_DRAW);
      gl.bindVertexArray(null);
      for (const part of [mesh.positions, mesh]) for (const name of ["data", "normals", "triangles", "joints", "weights", "uvs", "bind"]) {
        if (typeof part[name] === "string") part[name] = name === "uvs" ? true : null;
      }
    }
  }
  attribute(at, size, type, stride, offset, way) {
    const gl = this.gl;
    gl.enableVertexAttribArray(at);
    if (way === "whole") gl.vertexAttribIPointer(at, size, type, stride, offset);
    else gl.vertexAttribPointer(at, size, type, way === "norm", stride, offset);
  }
  begin(view, eye, size, near) {
    const gl = this.gl;
    this.view = view; this.eye = eye; this.size = size; this.near = near;
    gl.viewport(0, 0, size[0], size[1]); gl.clearColor(0.106, 0.118, 0.137, 1); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  }
  drawMeshes(take, t) {
    const gl = this.gl, at = this.skin.at;
    gl.useProgram(this.skin.made);
    gl.uniformMatrix4fv(at.uView, false, this.view); gl.uniform3fv(at.uEye, this.eye);
    gl.uniform1i(at.uBones, 0); gl.uniform1i(at.uImage, 1);
    gl.vertexAttribI4ui(5, 0, 0, 0, 0); gl.vertexAttrib4f(6, 0, 0, 0, 0);
    for (const mesh of take.meshes) {
      const material = mesh.material === null ? null : take.materials[mesh.material];
      const image = material && mesh.uvs ? take.textures[mesh.material] : null;
      gl.activeTexture(gl.TEXTURE1); gl.bindTexture(gl.TEXTURE_2D, image || this.blank);
      gl.activeTexture(gl.TEXTURE0); gl.bindTexture(gl.TEXTURE_2D, mesh.texture);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, 3, mesh.used.length, 0, gl.RGBA, gl.FLOAT, take.bones(t, mesh, mesh.rows));
      gl.uniform3fv(at.uOffset, mesh.positions.offset); gl.uniform1f(at.uStep, mesh.positions.step);
      gl.uniform4fv(at.uColour, material ? material.colour : [0.6, 0.63, 0.68, 1]);
      gl.uniform1i(at.uTextured, image ? 1 : 0);
      gl.bindVertexArray(mesh.array);
      gl.drawElements(gl.TRIANGLES, mesh.size, gl.UNSIGNED_INT, 0);
    }
    gl.bindVertexArray(null);
  }
  // Room for so many numbers, kept from picture to picture.
  room(count) {
    if (!this.numbers || this.numbers.length < count) this.numbers = new Float32Array(2 * count);
    return this.numbers;
  }
  upload(program, count, layout) {
    const gl = this.gl, stride = 4 * layout.reduce((a, b) => a + b, 0);
    gl.useProgram(program.made); gl.uniformMatrix4fv(program.at.uView, false, this.view);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, this.numbers.subarray(0, count), gl.STREAM_DRAW);
    let offset = 0;
    layout.forEach((size, i) => { this.attribute(i, size, gl.FLOAT, stride, offset); offset += 4 * size; });
    return 4 * count / stride;
  }
  drawLines(lines, width) {
    if (!lines.length) return;
    const numbers = this.room(72 * lines.length), gl = this.gl;
    let k = 0;
    for (const [a, b, colour] of lines) for (const corner of CORNERS) {
      numbers[k++] = a[0]; numbers[k++] = a[1]; numbers[k++] = a[2]; numbers[k++] = b[0]; numbers[k++] = b[1]; numbers[k++] = b[2];
      numbers[k++] = corner[0]; numbers[k++] = corner[1];
      numbers[k++] = colour[0]; numbers[k++] = colour[1]; numbers[k++] = colour[2]; numbers[k++] = colour[3];
    }
    const count = this.upload(this.lines, k, [3, 3, 2, 4]);
    gl.uniform2f(this.lines.at.uSize, this.size[0] / 2, this.size[1] / 2); gl.uniform1f(this.lines.at.uWidth, width / 2); gl.uniform1f(this.lines.at.uNear, this.near);
    gl.drawArrays(gl.TRIANGLES, 0, count); gl.disableVertexAttribArray(3);
  }
  drawPoints(points, scale) {
    if (!points.length) return;
    const numbers = this.room(8 * points.length);
    let k = 0;
    for (const [p, colour, size] of points) {
      numbers[k++] = p[0]; numbers[k++] = p[1]; numbers[k++] = p[2];
      numbers[k++] = colour[0]; numbers[k++] = colour[1]; numbers[k++] = colour[2]; numbers[k++] = colour[3]; numbers[k++] = size;
    }
    const count = this.upload(this.points, k, [3, 4, 1]);
    this.gl.uniform1f(this.points.at.uScale, scale); this.gl.drawArrays(this.gl.POINTS, 0, count);
  }
}
