// Draws a stage with WebGL2: the floor with soft shadows, then all parts in one call.

class GlView {
  constructor(canvas) {
    const gl = canvas.getContext("webgl2", { antialias: false, alpha: true, premultipliedAlpha: true });
    if (!gl) throw new Error("this browser gives no WebGL2");
    this.gl = gl; this.canvas = canvas; this.side = 256; this.room = 0;
    this.bodies = this.program(BODY_VERTEX, BODY_FRAGMENT);
    this.shadow = this.program(SHADOW_VERTEX, SHADOW_FRAGMENT);
    this.floor = this.program(FLOOR_VERTEX, FLOOR_FRAGMENT);
    this.table = gl.createTexture();
    this.sheet = this.makeSheet();
    gl.bindVertexArray(gl.createVertexArray()); // no attributes: vertices are known by their number
  }

  program(vertex, fragment) {
    const gl = this.gl, made = gl.createProgram();
    for (const [type, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, text); gl.compileShader(shader); gl.attachShader(made, shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) throw new Error(gl.getShaderInfoLog(shader));
    }
    gl.linkProgram(made);
    if (!gl.getProgramParameter(made, gl.LINK_STATUS) && !gl.isContextLost()) throw new Error(gl.getProgramInfoLog(made));
    const uniforms = [], count = gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS) || 0;
    for (let i = 0; i < count; i++) {
      const { name, type } = gl.getActiveUniform(made, i), where = gl.getUniformLocation(made, name);
      const set = { [gl.FLOAT]: (v) => gl.uniform1f(where, v), [gl.FLOAT_VEC3]: (v) => gl.uniform3fv(where, v),
        [gl.FLOAT_VEC4]: (v) => gl.uniform4fv(where, v), [gl.FLOAT_MAT4]: (v) => gl.uniformMatrix4fv(where, false, v) };
      uniforms.push({ name, set: set[type] || ((v) => gl.uniform1i(where, v)) });
    }
    return { made, uniforms };
  }

  use(program, values) {
    this.gl.useProgram(program.made);
    for (const { name, set } of program.uniforms) set(values[name]);
  }

  makeSheet() {
    const gl = this.gl, texture = gl.createTexture(), frame = gl.createFramebuffer();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, this.side, this.side, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);
    this.filter(gl.LINEAR);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
    return { texture, frame };
  }

  filter(how) {
    const gl = this.gl;
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, how);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
  }

  // Parts go to the card as a table; with `order`, in that order.
  load(parts, count, order) {
    const gl = this.gl;
    let rows = parts;
    if (order) {
      if (!this.sorted || this.sorted.length < parts.length) this.sorted = new Float32Array(parts.length);
      order.forEach((from, to) => this.sorted.set(parts.subarray(from * STRIDE, (from + 1) * STRIDE), to * STRIDE));
      rows = this.sorted;
    }
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, this.table);
    if (count > this.room) {
      this.room = parts.length / STRIDE;
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, 3, this.room, 0, gl.RGBA, gl.FLOAT, null);
      this.filter(gl.NEAREST);
    }
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, 3, count, gl.RGBA, gl.FLOAT, rows.subarray(0, count * STRIDE));
    gl.activeTexture(gl.TEXTURE0);
  }

  // Far parts first, as their soft edges mix with what is behind; marks lie on the floor and come before all.
  order(stage, camera) {
    const { parts, count } = stage, { eye } = camera, far = new Float32Array(count);
    for (let i = 0, o = 0; i < count; i++, o += STRIDE) {
      far[i] = [0, 1, 2].reduce((s, k) => s + ((parts[o + k] + parts[o + 4 + k]) / 2 - eye[k]) ** 2, parts[o + 11] === MARK ? 1e9 : 0);
    }
    return [...far.keys()].sort((a, b) => far[b] - far[a]);
  }

  draw(stage, camera, theme, focus) {
    const gl = this.gl, { width, height } = this.canvas;
    const values = { ...theme, centre: focus, eye: camera.eye, camera: camera.matrix, dark: theme.dark ? 1 : 0, body: stage.height,
      pixel: 1 / camera.scale, image: 0, parts: 1 };
    gl.disable(gl.DEPTH_TEST); gl.enable(gl.BLEND);
    this.shadows(stage, values);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.blendEquation(gl.FUNC_ADD); gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.bindTexture(gl.TEXTURE_2D, this.sheet.texture);
    this.use(this.floor, values);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    gl.enable(gl.DEPTH_TEST);
    this.load(stage.parts, stage.count, this.order(stage, camera));
    this.use(this.bodies, values);
    gl.drawArrays(gl.TRIANGLES, 0, 6 * stage.count);
  }

  shadows(stage, values) {
    const gl = this.gl;
    this.load(stage.parts, stage.casting);
    gl.bindTexture(gl.TEXTURE_2D, null);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.sheet.frame);
    gl.viewport(0, 0, this.side, this.side);
    gl.clearColor(0, 0, 0, 1); gl.clear(gl.COLOR_BUFFER_BIT);
    gl.blendEquation(gl.MAX);
    for (const under of [0, 1]) {
      this.use(this.shadow, { ...values, under });
      gl.drawArrays(gl.TRIANGLES, 0, 6 * stage.casting);
    }
  }

  free() { this.gl.getExtension("WEBGL_lose_context")?.loseContext(); }
}
