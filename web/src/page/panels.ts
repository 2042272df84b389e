// Panels that few sessions need, each imported on first use.

import { effect } from "@preact/signals-core";
import { byId } from "../base/dom.js";
import type { Connection } from "../protocol/connection.js";
import type { Scene, TaskScope } from "../protocol/messages.js";
import type { Requests } from "../state/requests.js";
import type { Session } from "../state/session.js";
import type { Vec3 } from "../base/geometry.js";
import type { VolumeView } from "../volume/volume_view.js";
import { LazyModule } from "../words/lazy_module.js";
import type { VoxelChanges } from "./voxels.js";

export interface PanelsContext {
  session: Session;
  connection: Connection;
  requests: Requests;
  volume: VolumeView;
  voxels: VoxelChanges;
  token(): string | null;
  /** Sets up the view of a scope for a task. */
  setUpScope(scope: TaskScope): void;
  /** Moves the planes to a position, patient frame. */
  showPosition(position: Vec3): void;
}

export class Panels {
  readonly timeline = new LazyModule("recording", async () => {
    const { session, connection, requests } = this.context;
    return new (await import("../panels/timeline.js")).Timeline(session, connection, requests);
  });
  readonly training = new LazyModule("training", async () => {
    const { session, connection, requests, volume, voxels, setUpScope } = this.context;
    const { Training, Quiz } = await import("../training/training.js");
    return new Training(session, connection, requests, volume, (toFind) => voxels.hide(toFind, Quiz), setUpScope);
  });
  readonly lesson = new LazyModule("lesson", async () => {
    const { session, connection, requests, token } = this.context;
    return new (await import("../training/lesson.js")).Lesson(session, connection, requests, token);
  });
  readonly near = new LazyModule("near", async () => {
    const { session, connection } = this.context;
    return new (await import("../panels/near_panel.js")).NearPanel(session, connection);
  });
  readonly plan = new LazyModule("plan", async () => {
    const { session, connection, showPosition } = this.context;
    return new (await import("../panels/plan_panel.js")).PlanPanel(session, connection, showPosition);
  });

  constructor(private readonly context: PanelsContext) {
    byId("plan-card").addEventListener("toggle", () => void this.plan.get());
    effect(() => {
      if (context.session.plans.drawn.length > 0) void this.plan.get();
    });
  }

  /** Loads the panels that a scene needs. */
  async fetchFor({ tasks, recording, distances, no_go, may, role }: Scene): Promise<void> {
    const wanted = [
      ...(tasks && tasks.length > 0 ? [this.training] : []),
      ...(may.includes("lesson") || role === "learner" || role === "teacher" ? [this.lesson] : []),
      ...(recording ? [this.timeline] : []),
      ...(distances || no_go.length > 0 ? [this.near] : []),
    ];
    await Promise.all(wanted.map((part) => part.get()));
  }
}
