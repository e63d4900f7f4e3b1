/**
 * The 3-D view: vehicle, thrust arrows, trail, reference path, ground. Loaded on demand, as three.js is four fifths of the page.
 *
 * World frame of the view: x east, y up, z south, m; from north, east, down by (n, e, d) → (e, −d, −n).
 */
import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { mergeGeometries } from "three/addons/utils/BufferGeometryUtils.js";
import { Pace } from "./pace";
import type { Geometry, Pose } from "./motion";
import { levels } from "../parts/coaxial";

/** Loss at which the colour saturates, share of the nominal thrust. */
const FULL_LOSS = 0.25;
/** Length of an arrow of hover thrust, in arm lengths. */
const ARROW = 1.1;
/** The vehicle is drawn enlarged; otherwise a flight of 10 m would show a dot. */
const MAGNIFY = 2.5;

export interface Colours {
  background: string;
  grid: string;
  body: string;
  good: string;
  warn: string;
  bad: string;
  trail: string;
  reference: string;
  ghost: string;
}

type Point = readonly [number, number, number];
const world = ([north, east, down]: Point) => new THREE.Vector3(east, -down, -north);

/** Few objects, as each is a draw call in each frame: a body, all discs, all shafts and all heads of the arrows. */
interface Craft {
  group: THREE.Group;
  discs: THREE.InstancedMesh;
  /** Where the discs are, in the group. */
  places: THREE.Vector3[];
  arrows: { shafts: THREE.LineSegments; heads: THREE.InstancedMesh } | undefined;
}

/** Most points of a trail; its buffer is allocated once. */
const TRAIL_POINTS = 512;
/** Renderers that draw on the processor: expensive features are avoided there. */
const SOFTWARE = /swiftshader|llvmpipe|softpipe|software|basic render/i;

export class Scene {
  private readonly renderer: THREE.WebGLRenderer;
  private readonly scene = new THREE.Scene();
  private readonly camera = new THREE.PerspectiveCamera(45, 1, 0.05, 2000);
  private readonly controls: OrbitControls;
  private readonly craft: Craft;
  private readonly ghost: Craft;
  private readonly trail: THREE.Line;
  private readonly reference: THREE.Line;
  private readonly ghostTrail: THREE.Line;
  private grid: THREE.GridHelper | undefined;
  private follow = true;
  private last = new THREE.Vector3();
  private pending = 0;
  private readonly pace = new Pace();
  private held: ReturnType<typeof setTimeout> | undefined;
  private sharpen: ReturnType<typeof setTimeout> | undefined;

  constructor(
    private readonly holder: HTMLElement,
    private readonly geometry: Geometry,
    private colours: Colours,
  ) {
    this.renderer = new THREE.WebGLRenderer({ antialias: !isSoftware(), powerPreference: "high-performance" });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 1.5));
    holder.append(this.renderer.domElement);
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x606060, 2.4));
    const sun = new THREE.DirectionalLight(0xffffff, 1.6);
    sun.position.set(4, 9, 6);
    this.scene.add(sun);
    this.craft = this.vehicle(1);
    this.ghost = this.vehicle(0.35);
    this.ghost.group.visible = false;
    const path = () => {
      const line = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial());
      line.frustumCulled = false;
      this.scene.add(line);
      return line;
    };
    [this.trail, this.reference, this.ghostTrail] = [path(), path(), path()];
    this.trail.geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(3 * TRAIL_POINTS), 3).setUsage(THREE.DynamicDrawUsage));
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.maxPolarAngle = 1.55;
    this.controls.addEventListener("change", () => this.draw());
    const reach = Math.max(2.5, 14 * geometry.arm_m);
    this.camera.position.set(-0.5 * reach, 0.55 * reach, 0.85 * reach);
    this.paint(colours);
    this.resize();
  }

  /** Sets the colours: dark or light. */
  paint(colours: Colours): void {
    this.colours = colours;
    this.scene.background = new THREE.Color(colours.background);
    if (this.grid) {
      this.scene.remove(this.grid);
      this.grid.dispose();
    }
    this.grid = new THREE.GridHelper(100, 100, colours.grid, colours.grid);
    this.scene.add(this.grid);
    const paint = (line: THREE.Line, colour: string) => (line.material as THREE.LineBasicMaterial).color.set(colour);
    paint(this.trail, colours.trail);
    paint(this.reference, colours.reference);
    paint(this.ghostTrail, colours.ghost);
    this.draw();
  }

  /** Paths of the whole flight. */
  paths(reference: readonly Point[], ghost: readonly Point[]): void {
    this.reference.geometry.dispose();
    this.reference.geometry = new THREE.BufferGeometry().setFromPoints(reference.map(world));
    this.ghostTrail.geometry.dispose();
    this.ghostTrail.geometry = new THREE.BufferGeometry().setFromPoints(ghost.map(world));
    this.draw();
  }

  /** Shows the flight at a time, with the trail up to it. */
  show(pose: Pose, trail: readonly Point[], ghost: Pose | undefined): void {
    this.place(this.craft, pose);
    const points = this.trail.geometry.getAttribute("position");
    const shown = Math.min(trail.length, TRAIL_POINTS);
    for (let k = 0; k < shown; k += 1) {
      const [north, east, down] = trail[trail.length - shown + k] as Point;
      points.setXYZ(k, east, -down, -north);
    }
    points.needsUpdate = true;
    this.trail.geometry.setDrawRange(0, shown);
    this.ghost.group.visible = ghost !== undefined;
    if (ghost) this.place(this.ghost, ghost);
    const at = this.craft.group.position;
    if (this.follow) {
      const moved = at.clone().sub(this.last);
      this.camera.position.add(moved);
      this.controls.target.copy(at);
    }
    this.last.copy(at);
    this.controls.update();
    this.draw();
  }

  /** The camera follows the vehicle, or is fixed. */
  setFollow(follow: boolean): void {
    this.follow = follow;
  }

  resize(): void {
    const [width, height] = [this.holder.clientWidth, this.holder.clientHeight];
    if (width === 0 || height === 0) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  dispose(): void {
    cancelAnimationFrame(this.pending);
    clearTimeout(this.sharpen);
    clearTimeout(this.held);
    this.controls.dispose();
    this.renderer.dispose();
    this.renderer.domElement.remove();
  }

  private draw(): void {
    if (this.pending || this.held) return;
    const pause = this.pace.pause();
    if (pause > 0) this.held = setTimeout(() => { this.held = undefined; this.paintSoon(); }, pause);
    else this.paintSoon();
  }

  private paintSoon(): void {
    this.pending = requestAnimationFrame((now) => {
      this.pending = 0;
      // Fewer pixels if frames are late; full resolution once nothing has moved for a while.
      const ratio = this.pace.ratio(now) * Math.min(devicePixelRatio, 1.5);
      if (Math.abs(ratio - this.renderer.getPixelRatio()) > 1e-6) this.renderer.setPixelRatio(ratio);
      this.renderer.render(this.scene, this.camera);
      clearTimeout(this.sharpen);
      if (this.pace.isReduced()) this.sharpen = setTimeout(() => this.draw(), Pace.STILL_MS);
    });
  }

  private vehicle(opacity: number): Craft {
    const { arm_m: arm, rotors } = this.geometry;
    const group = new THREE.Group();
    group.scale.setScalar(MAGNIFY);
    const places = rotors.map((rotor) => world(rotor.position_body_m));
    const level = levels(rotors);
    const booms = places.map((at) => {
      const turn = new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 1, 0), at.clone().normalize());
      return new THREE.CylinderGeometry(0.035 * arm, 0.035 * arm, at.length(), 8).applyMatrix4(new THREE.Matrix4().compose(at.clone().multiplyScalar(0.5), turn, new THREE.Vector3(1, 1, 1)));
    });
    const body = mergeGeometries([new THREE.BoxGeometry(0.45 * arm, 0.14 * arm, 0.5 * arm), ...booms]);
    const hull = new THREE.Mesh(body, new THREE.MeshLambertMaterial({ color: this.colours.body, transparent: opacity < 1, opacity }));
    const nose = new THREE.Mesh(new THREE.ConeGeometry(0.09 * arm, 0.3 * arm, 12), new THREE.MeshLambertMaterial({ color: this.colours.trail, transparent: opacity < 1, opacity }));
    nose.rotation.x = -Math.PI / 2;
    nose.position.set(0, 0, -0.38 * arm);
    const upper = rotors.filter((_, k) => level[k] === 0);
    const spacing = Math.min(...upper.flatMap((a, i) => upper.slice(i + 1).map((b) => Math.hypot(a.position_body_m[0] - b.position_body_m[0], a.position_body_m[1] - b.position_body_m[1]))));
    const radius = Math.min(0.45 * arm, 0.47 * (Number.isFinite(spacing) ? spacing : arm));
    // On an axis of two, one above the boom and one below it, whatever their heights.
    places.forEach((at, k) => (at.y += (level[k] === 0 ? 0.09 : -0.09) * arm));
    const discs = new THREE.InstancedMesh(new THREE.CylinderGeometry(radius, radius, 0.03 * arm, 32), new THREE.MeshLambertMaterial({ transparent: true, opacity: 0.8 * opacity }), rotors.length);
    places.forEach((at, k) => {
      discs.setMatrixAt(k, new THREE.Matrix4().setPosition(at));
      discs.setColorAt(k, new THREE.Color(this.colours.good));
    });
    group.add(hull, nose, discs);
    let arrows: Craft["arrows"];
    if (opacity === 1) {
      const colour = this.colours.reference;
      const shafts = new THREE.LineSegments(
        new THREE.BufferGeometry().setAttribute("position", new THREE.BufferAttribute(new Float32Array(6 * rotors.length), 3).setUsage(THREE.DynamicDrawUsage)),
        new THREE.LineBasicMaterial({ color: colour }),
      );
      // A head of height 1 with its tip at the origin; scaled and placed by the thrust.
      const heads = new THREE.InstancedMesh(new THREE.ConeGeometry(0.065 * arm, 1, 8).translate(0, -0.5, 0), new THREE.MeshBasicMaterial({ color: colour }), rotors.length);
      shafts.frustumCulled = false;
      heads.frustumCulled = false;
      group.add(shafts, heads);
      arrows = { shafts, heads };
    }
    this.scene.add(group);
    return { group, discs, places, arrows };
  }

  private place(craft: Craft, pose: Pose): void {
    craft.group.position.copy(world(pose.position));
    const [roll, pitch, yaw] = pose.attitude;
    // ZYX in NED: yaw about down, then pitch about right, then roll about forward; forward is −z, right x, down −y here.
    const turn = new THREE.Quaternion().setFromAxisAngle(new THREE.Vector3(0, -1, 0), yaw);
    turn.multiply(new THREE.Quaternion().setFromAxisAngle(new THREE.Vector3(1, 0, 0), pitch));
    turn.multiply(new THREE.Quaternion().setFromAxisAngle(new THREE.Vector3(0, 0, -1), roll));
    craft.group.quaternion.copy(turn);
    const [good, warn, bad] = [new THREE.Color(this.colours.good), new THREE.Color(this.colours.warn), new THREE.Color(this.colours.bad)];
    const arm = this.geometry.arm_m;
    craft.places.forEach((at, k) => {
      const loss = pose.loss[k] ?? 0;
      craft.discs.setColorAt(k, loss > 0 ? warn.clone().lerp(bad, Math.min(1, loss / FULL_LOSS)) : pose.suspect[k] ? warn : good);
      if (!craft.arrows) return;
      const hover = this.geometry.hover?.rotor_thrust_n[k] ?? 1;
      const length = Math.max(1e-3, (ARROW * arm * Math.max(0, pose.thrust[k] ?? 0)) / Math.max(1e-9, hover));
      const head = Math.min(0.22 * arm, 0.4 * length);
      const ends = craft.arrows.shafts.geometry.getAttribute("position");
      ends.setXYZ(2 * k, at.x, at.y, at.z);
      ends.setXYZ(2 * k + 1, at.x, at.y + length - head, at.z);
      ends.needsUpdate = true;
      craft.arrows.heads.setMatrixAt(k, new THREE.Matrix4().makeScale(1, head, 1).setPosition(at.x, at.y + length, at.z));
    });
    if (craft.discs.instanceColor) craft.discs.instanceColor.needsUpdate = true;
    if (craft.arrows) craft.arrows.heads.instanceMatrix.needsUpdate = true;
  }
}

/** Whether this browser renders 3-D on the processor. */
function isSoftware(): boolean {
  const context = document.createElement("canvas").getContext("webgl2");
  const info = context?.getExtension("WEBGL_debug_renderer_info");
  const name = String((info && context?.getParameter(info.UNMASKED_RENDERER_WEBGL)) ?? "");
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return SOFTWARE.test(name);
}
