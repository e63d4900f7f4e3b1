/**
 * The 3-D picture: vehicle, thrust arrows, trail, reference path, ground. Loaded on demand, as three.js is four fifths of the page.
 *
 * World of the picture: x east, y up, z south, m; from north, east, down by (n, e, d) → (e, −d, −n).
 */
import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import type { Geometry, Pose } from "./motion";

/** A loss that is coloured fully, share of the nominal thrust. */
const FULL_LOSS = 0.25;
/** Length of an arrow of hover thrust, in arm lengths. */
const ARROW = 1.1;
/** The vehicle is drawn larger than it is, or a flight of 10 m would show a dot. */
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

interface Craft {
  group: THREE.Group;
  discs: THREE.Mesh<THREE.CylinderGeometry, THREE.MeshStandardMaterial>[];
  arrows: THREE.ArrowHelper[];
}

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

  constructor(
    private readonly holder: HTMLElement,
    private readonly geometry: Geometry,
    private colours: Colours,
  ) {
    this.renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: false });
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
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.maxPolarAngle = 1.55;
    this.controls.addEventListener("change", () => this.draw());
    const reach = Math.max(2.5, 14 * geometry.arm_m);
    this.camera.position.set(-0.5 * reach, 0.55 * reach, 0.85 * reach);
    this.paint(colours);
    this.resize();
  }

  /** Takes other colours: dark or light. */
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

  /** The flight at a time, with the trail up to it. */
  show(pose: Pose, trail: readonly Point[], ghost: Pose | undefined): void {
    this.place(this.craft, pose);
    this.trail.geometry.dispose();
    this.trail.geometry = new THREE.BufferGeometry().setFromPoints(trail.map(world));
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

  /** The camera goes with the vehicle, or stays. */
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
    this.controls.dispose();
    this.renderer.dispose();
    this.renderer.domElement.remove();
  }

  private draw(): void {
    if (this.pending) return;
    this.pending = requestAnimationFrame(() => {
      this.pending = 0;
      this.renderer.render(this.scene, this.camera);
    });
  }

  private vehicle(opacity: number): Craft {
    const { arm_m: arm, rotors } = this.geometry;
    const group = new THREE.Group();
    group.scale.setScalar(MAGNIFY);
    const material = () => new THREE.MeshStandardMaterial({ color: this.colours.body, roughness: 0.7, transparent: opacity < 1, opacity });
    const hub = new THREE.Mesh(new THREE.BoxGeometry(0.45 * arm, 0.14 * arm, 0.5 * arm), material());
    const nose = new THREE.Mesh(new THREE.ConeGeometry(0.09 * arm, 0.3 * arm, 12), new THREE.MeshStandardMaterial({ color: this.colours.trail, transparent: opacity < 1, opacity }));
    nose.rotation.x = -Math.PI / 2;
    nose.position.set(0, 0, -0.38 * arm);
    group.add(hub, nose);
    const spacing = Math.min(...rotors.flatMap((a, i) => rotors.slice(i + 1).map((b) => Math.hypot(a.position_body_m[0] - b.position_body_m[0], a.position_body_m[1] - b.position_body_m[1]))));
    const radius = Math.min(0.45 * arm, 0.47 * (Number.isFinite(spacing) ? spacing : arm));
    const discs: Craft["discs"] = [];
    const arrows: THREE.ArrowHelper[] = [];
    for (const rotor of rotors) {
      const at = world(rotor.position_body_m);
      const boom = new THREE.Mesh(new THREE.CylinderGeometry(0.035 * arm, 0.035 * arm, at.length(), 8), material());
      boom.position.copy(at).multiplyScalar(0.5);
      boom.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), at.clone().normalize());
      const disc = new THREE.Mesh(
        new THREE.CylinderGeometry(radius, radius, 0.03 * arm, 40),
        new THREE.MeshStandardMaterial({ color: this.colours.good, roughness: 0.5, transparent: true, opacity: 0.8 * opacity }),
      );
      disc.position.copy(at).setY(at.y + 0.09 * arm);
      const arrow = new THREE.ArrowHelper(new THREE.Vector3(0, 1, 0), disc.position, arm, this.colours.reference, 0.22 * arm, 0.13 * arm);
      arrow.visible = opacity === 1;
      group.add(boom, disc, arrow);
      discs.push(disc);
      arrows.push(arrow);
    }
    this.scene.add(group);
    return { group, discs, arrows };
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
    craft.discs.forEach((disc, k) => {
      const loss = pose.loss[k] ?? 0;
      if (loss > 0) disc.material.color.copy(warn).lerp(bad, Math.min(1, loss / FULL_LOSS));
      else disc.material.color.copy(pose.suspect[k] ? warn : good);
      const hover = this.geometry.hover.rotor_thrust_n[k] ?? 1;
      const length = (ARROW * this.geometry.arm_m * Math.max(0, pose.thrust[k] ?? 0)) / Math.max(1e-9, hover);
      craft.arrows[k]?.setLength(Math.max(1e-3, length), Math.min(0.22 * this.geometry.arm_m, 0.4 * length), 0.13 * this.geometry.arm_m);
    });
  }
}
