// How things look: the studio of the pictures (kernels/pictures/surfaces.py), and rubber that shines. ground.js has the ground.
(() => {
  "use strict";
  const GLOSSY = 0.14, SATIN = 0.5;  // roughness of balloons, and of all else
  const NEUTRAL = 7, HALF = 1016, RGBA = 1023, LINEAR = 1006, AROUND = 303, DOUBLE = 2, REPEAT = 1000, PCF = 1;  // in three.js
  const KEY = unit([-0.62, 1.0, 0.62]), RIM = unit([0.95, 0.28, -0.15]);  // toward the lights, for who looks along -z
  const FLOOR = [0.72, 0.70, 0.66];
  const dressed = new WeakSet(), softened = new WeakSet();

  function dot(a, b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
  function cross(a, b) {
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  }
  function unit(a) { const length = Math.sqrt(dot(a, a)); return a.map((x) => x / length); }
  function mix(a, b, t) { return a.map((x, n) => x + t * (b[n] - x)); }
  function smoothstep(low, high, x) {
    const t = Math.min(Math.max((x - low) / (high - low), 0), 1);
    return t * t * (3 - 2 * t);
  }

  // How much of a soft-edged rectangular light is seen along a direction.
  function panel(direction, toward, half, blur) {
    const right = unit(cross([0, 1, 0], toward)), up = cross(toward, right), ahead = dot(direction, toward);
    if (ahead <= 0.05) return 0;
    const x = Math.abs(dot(direction, right)) / ahead, y = Math.abs(dot(direction, up)) / ahead;
    return (1 - smoothstep(half[0] - blur, half[0] + blur, x)) * (1 - smoothstep(half[1] - blur, half[1] + blur, y));
  }

  function radiance(direction, turned) {
    const floor = mix(FLOOR.map((x) => 0.34 * x), FLOOR.map((x) => 0.7 * x), smoothstep(-0.7, 0, direction[1]));
    const sky = mix([0.60, 0.59, 0.58], [0.85, 0.88, 0.92], smoothstep(0, 0.9, direction[1]));
    const room = mix(floor, sky, smoothstep(-0.15, 0.15, direction[1]));
    const key = 3.6 * panel(direction, turned(KEY), [0.30, 0.42], 0.05);
    const rim = 1.6 * panel(direction, turned(RIM), [0.14, 0.70], 0.05);
    return room.map((x) => x + key + rim);
  }

  function half(x) {  // a positive number as 16 bits have it
    return (new Uint32Array(new Float32Array([Math.max(x, 1e-4)]).buffer)[0] >> 13) - (112 << 10);
  }

  // The room as a picture all around, turned about the vertical by an angle.
  function studio(Texture, angle) {
    const width = 256, height = 128, data = new Uint16Array(4 * width * height);
    const c = Math.cos(angle), s = Math.sin(angle);
    const turned = (a) => [c * a[0] + s * a[2], a[1], -s * a[0] + c * a[2]];
    for (let row = 0; row < height; row++) for (let column = 0; column < width; column++) {
      const up = Math.PI * ((row + 0.5) / height - 0.5), around = 2 * Math.PI * ((column + 0.5) / width - 0.5);
      const direction = [Math.cos(up) * Math.cos(around), Math.sin(up), Math.cos(up) * Math.sin(around)];
      const light = radiance(direction, turned);
      for (let n = 0; n < 3; n++) data[4 * (row * width + column) + n] = half(light[n]);
      data[4 * (row * width + column) + 3] = half(1);
    }
    const texture = new Texture({data, width, height}, AROUND);
    Object.assign(texture, {
      isDataTexture: true, format: RGBA, type: HALF, minFilter: LINEAR, magFilter: LINEAR,
      generateMipmaps: false, flipY: false, unpackAlignment: 1, needsUpdate: true,
    });
    return texture;
  }

  // Half of the room's light, as in the pictures, but all of what it mirrors, and lights that outshine it; rubber
  // lets some light through, and mirrors less at a slant, or gray floor would draw a line around each balloon.
  function dressMaterial(material) {
    if (!material || !material.isMeshStandardMaterial || dressed.has(material)) return;
    dressed.add(material);
    const rubber = material.side === DOUBLE && !material.flatShading;
    material.roughness = rubber ? GLOSSY : SATIN;
    material.onBeforeCompile = (shader) => {
      shader.fragmentShader = shader.fragmentShader.replace("#include <lights_fragment_maps>", `
        #include <lights_fragment_maps>
        iblIrradiance *= 0.42;
        radiance += 7.0 * max(radiance - vec3(1.0), vec3(0.0));
      `).replace("#include <lights_physical_fragment>", `
        #include <lights_physical_fragment>
        material.specularF90 = ${rubber ? "0.3" : "1.0"};
      `).replace("#include <emissivemap_fragment>", `
        #include <emissivemap_fragment>
        totalEmissiveRadiance += ${rubber ? "0.12" : "0.0"} * diffuseColor.rgb;
      `);
    };
    material.customProgramCacheKey = () => `balloon-warp ${rubber}`;
    material.needsUpdate = true;
  }

  // A print (`layers.py`): below its balloon's node hang the image, and a mesh of places in it. Returns the balloon.
  function dressPrint(node) {
    const image = node.material.isMeshBasicMaterial && node.material.map;
    if (!image || !image.image) return null;
    const rubber = (mesh) => mesh.isMesh && mesh.material.isMeshStandardMaterial;
    for (let above = node.parent; above; above = above.parent) {
      const balloon = above.children.find(rubber);
      if (!balloon) continue;
      let places = null;
      above.traverse((mesh) => { if (mesh !== balloon && rubber(mesh)) places = mesh.geometry.attributes.position; });
      const {geometry, material} = balloon, {position, uv} = geometry.attributes;
      if (!places || !position || places.count !== position.count) return balloon;
      if (!uv || uv.count !== places.count || geometry.userData.places !== places.array) {
        geometry.userData.places = places.array;
        const at = new Float32Array(2 * places.count);
        for (let n = 0; n < places.count; n++) { at[2 * n] = places.getX(n); at[2 * n + 1] = places.getY(n); }
        geometry.setAttribute("uv", new places.constructor(at, 2));
        joinSeams(geometry, places);
      }
      if (material.userData.print !== image) {
        const map = image.clone();
        Object.assign(map, {wrapS: REPEAT, wrapT: REPEAT, colorSpace: "srgb", anisotropy: 4, needsUpdate: true});
        material.userData.print = image;
        material.map = map;
        material.needsUpdate = true;
      }
      return balloon;
    }
    return null;
  }

  // The page may give the mesh of a balloon that had a print to one that has none.
  function undressPrints(were, are) {
    for (const {geometry, material} of were) if (!are.some((mesh) => mesh.material === material)) {
      material.map = material.userData.print = null;
      material.needsUpdate = true;
      delete geometry.computeVertexNormals;
    }
  }

  // Points that were cut from each other along a seam of the print get one normal, or the seam would show as a crease.
  function joinSeams(geometry, places) {
    const cut = [];
    delete geometry.computeVertexNormals;
    for (let n = 0; n < places.count; n++) if (places.getZ(n) !== n) cut.push([n, places.getZ(n)]);
    if (!cut.length) return;
    const prototype = Object.getPrototypeOf(geometry);
    geometry.computeVertexNormals = function () {
      prototype.computeVertexNormals.call(this);
      const all = this.attributes.normal;
      if (all.count !== places.count) return;
      for (const [n, m] of cut) {
        all.setXYZ(m, all.getX(m) + all.getX(n), all.getY(m) + all.getY(n), all.getZ(m) + all.getZ(n));
      }
      for (const m of new Set(cut.map((pair) => pair[1]))) {
        all.setXYZ(m, ...unit([all.getX(m), all.getY(m), all.getZ(m)]));
      }
      for (const [n, m] of cut) all.setXYZ(n, all.getX(m), all.getY(m), all.getZ(m));
    };
  }

  // The key light, over what throws a shadow, and its shadow no larger than that.
  function aim(light, things, toward) {
    let radius = 0;
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    for (const mesh of things) {
      const ball = mesh.geometry.boundingSphere.clone().applyMatrix4(mesh.matrixWorld);
      ball.center.toArray().forEach((x, n) => {
        low[n] = Math.min(low[n], x - ball.radius);
        high[n] = Math.max(high[n], x + ball.radius);
      });
    }
    if (!things.length || !low.every(Number.isFinite) || !high.every(Number.isFinite)) return;
    radius = Math.hypot(...low.map((x, n) => high[n] - x)) / 2;
    radius = Math.pow(1.25, Math.ceil(Math.log(radius) / Math.log(1.25)));  // it flickers less than it would grow
    const pixel = 2 * radius / light.shadow.mapSize.x;
    const center = low.map((x, n) => pixel * 8 * Math.round((x + high[n]) / 2 / pixel / 8));
    light.parent.worldToLocal(light.position.fromArray(center.map((x, n) => x + 3 * radius * toward[n])));
    light.target.position.fromArray(center);
    light.updateMatrixWorld();
    light.target.updateMatrixWorld();
    const camera = light.shadow.camera;
    Object.assign(camera, {left: -radius, right: radius, bottom: -radius, top: radius, near: 0.1 * radius,
      far: 40 * radius});
    camera.updateProjectionMatrix();
    // A surface that is lit at a slant shadows itself in spots, unless it is asked a little above itself.
    light.shadow.normalBias = 2.5 * pixel;
    light.shadow.bias = 0;
    light.shadow.radius = 6;
  }

  function dress(scene, camera, state) {
    const lights = [], things = [], printed = [], grounds = [];
    scene.traverse((node) => {
      if (node.isDirectionalLight) lights.push(node);
      if (!node.isMesh) return;
      if (node.material.isShaderMaterial) grounds.push(node.material);
      dressMaterial(node.material);
      if (!softened.has(node.material)) {  // what was made ready for another kind of shadow is made ready anew
        softened.add(node.material);
        node.material.needsUpdate = true;
      }
      const balloon = dressPrint(node);
      if (balloon) printed.push(balloon);
      if (node.castShadow && node.parent.visible && node.material.isMeshStandardMaterial && node.geometry.boundingSphere) things.push(node);
    });
    for (const material of grounds) window.balloonWarpGround(material, things);
    undressPrints(state.printed || [], printed);
    state.printed = printed;
    if (state.angle === undefined && things.length) {  // once, from where the camera stands at first
      const e = camera.matrixWorld.elements;
      state.angle = Math.atan2(e[8], e[10]);
    }
    if (state.angle === undefined) return;
    const c = Math.cos(state.angle), s = Math.sin(state.angle);
    const [key, ...others] = lights;
    // viser splits a light that throws shadows in three, each for a part of what is seen: one does, which is aimed.
    for (const light of others) {
      if (light.visible) key.intensity += light.intensity;
      light.visible = false;
    }
    if (key) aim(key, things, [c * KEY[0] + s * KEY[2], KEY[1], -s * KEY[0] + c * KEY[2]]);
    if (scene.environment && !state.studio) state.studio = studio(scene.environment.constructor, state.angle);
    if (scene.environment && state.studio) scene.environment = state.studio;
  }

  // three.js tells its developer tools of every scene. So we come to what viser's messages cannot set.
  const tools = new EventTarget();
  tools.addEventListener("observe", ({detail: scene}) => {
    if (!scene.isScene) return;
    const state = {};
    scene.onBeforeRender = (renderer, _, camera, target) => {
      if (target || !camera.isPerspectiveCamera) return;
      renderer.toneMapping = NEUTRAL;
      renderer.shadowMap.type = PCF;  // whose edges are as soft as `shadow.radius` says
      dress(scene, camera, state);
    };
  });
  window.__THREE_DEVTOOLS__ = tools;
})();
