// Figures of the contact: force, structure, stiffness, depth, and what withholds or changes the force.

import { announce } from "../base/announce.js";
import { byId, element, write } from "../base/dom.js";
import { limitText, measured, quantity } from "../words/figures.js";
import { angleOf_deg, length } from "../base/geometry.js";
import type { Session } from "../state/session.js";
import { forceExplanation } from "./force_explanation.js";
import { type Contact, type DevicePose, type PathPart, Flag, type Pose } from "../protocol/wire.js";
import { words, type Words } from "../words/words.js";

/** Flags of a tick, in display order. */
const FLAGS: (keyof Words["flags"])[] = [
  "emergencyStop",
  "paused",
  "stale",
  "deviceFault",
  "halted",
  "jump",
  "notFinite",
  "noGo",
  "clamped",
  "thermal",
  "clutched",
  "wedged",
  "ruptured",
  "inside",
  "passivity",
  "turnHeld",
  "release",
  "ramp",
];
/** Rotation of the object below which it counts as not turned. */
const MIN_TURN_DEG = 0.05;

export class ContactPanel {
  private announced = ""; // conditions of the force announced last

  constructor(private readonly session: Session) {
    session.onFigures(() => {
      if (session.pose.value) this.draw(session.pose.value);
    });
  }

  private draw(pose: Pose): void {
    const { session } = this;
    const device = pose.devices[0]!;
    const contact = session.contactOf(device);
    const force_N = length(device.force);
    const [force, unit] = measured(force_N, "N");
    write(byId("force"), force);
    write(byId("force-unit"), unit);
    write(byId("force-limit"), limitText(device.forceLimit, session.state.value?.max_force_N ?? device.forceLimit));
    byId<HTMLMeterElement>("force-meter").value = Math.min(1, force_N / Math.max(device.forceLimit, 1e-6));
    write(byId("touched"), contact.words);
    write(byId("stiffness"), contact.label > 0 && device.stiffness > 0 ? quantity(device.stiffness, "N/mm") : "–");
    write(byId("depth"), Number.isFinite(device.depth) ? quantity(device.depth, "mm") : "–");
    write(byId("speed"), quantity(device.speed, "mm/s"));
    this.drawPathParts(contact.label > 0 ? device.path : []);
    this.drawContacts(contact.label > 0 ? device.contacts : []);
    write(byId("heat"), Number.isFinite(device.heat) ? `${Math.round(100 * device.heat)} %` : "–");
    write(
      byId("force-explanation"),
      contact.label > 0 ? forceExplanation(device, session.toPatient(pose, device.force)) : "",
    );
    const angle = angleOf_deg(pose.rotation);
    write(byId("turned"), angle > MIN_TURN_DEG ? words.turnedBy(`${angle.toFixed(0)}°`) : words.notTurned);
    const conditions = this.conditionsOf(device).join(" · ");
    write(byId("flags"), conditions);
    if (conditions !== this.announced) announce(conditions);
    this.announced = conditions;
  }

  /** Draws the structures along the penetration path, outermost first: path length in each and share of the force. */
  private drawPathParts(path: PathPart[]): void {
    const rows = byId<HTMLTableElement>("felt").tBodies[0]!;
    while (rows.rows.length < path.length)
      rows.append(element("tr", {}, element("th", { scope: "row" }), element("td"), element("td")));
    for (const [n, row] of [...rows.rows].entries()) {
      const part = path[n];
      row.hidden = part === undefined;
      if (part === undefined) continue;
      const [name, depth, share] = row.cells;
      write(name!, this.session.nameOf(part.label));
      write(depth!, Number.isFinite(part.depth) ? quantity(part.depth, "mm") : words.deep);
      write(share!, `${Math.round(100 * part.share)} %`);
    }
  }
  /** Draws the structures in contact with parts of the tool, if there are several contacts. */
  private drawContacts(contacts: Contact[]): void {
    const summary = byId("contacts");
    const named = contacts.map(({ label, force }) => `${this.session.nameOf(label)} ${quantity(force, "N")}`);
    const text = contacts.length > 1 ? words.inContactWith(named.join(", ")) : "";
    write(summary, text);
    summary.title = text;
  }

  /** Texts of conditions that withhold or change the force, with the source of a stop and the remedy. */
  private conditionsOf(device: DevicePose): string[] {
    const { session } = this;
    const scene = session.scene.value,
      state = session.state.value,
      pushing = session.pushing.value;
    // a pointer without input is idle, which is no fault
    const isResting = scene?.device.input === "pointer" && (device.flags & Flag.stale) !== 0;
    const flags = FLAGS.filter(
      (name) => device.flags & Flag[name] && !(isResting && (name === "stale" || name === "ramp")),
    );
    const all = flags.map((name) => {
      if (name === "emergencyStop" && state?.stopped_by) return words.stoppedBy[state.stopped_by];
      return name === "noGo" && pushing ? words.keptAwayFrom(session.regionName(pushing.region)) : words.flags[name];
    });
    if (state?.stop != null)
      return [...all, this.rearmHint((device.flags & (Flag.contact | Flag.inside | Flag.noGo)) !== 0)];
    if (isResting)
      all.push(state?.pointer ? words.holdToTouch : state?.pointer_by ? words.pointerIdleElsewhere : words.pointerFree);
    return all;
  }
  /** Instruction to lift a stop, given whether the tip is in contact. */
  private rearmHint(touches: boolean): string {
    const scene = this.session.scene.value,
      state = this.session.state.value;
    if (scene?.device.simulated === false) return words.rearmThere;
    if (scene?.device.input === "pointer" && !state?.pointer) return words.rearmOther;
    if (touches && scene?.device.input === "script") return words.rearmWhenFree;
    if (touches) return words.rearmOutOfContact;
    return words.rearmNow;
  }
}
