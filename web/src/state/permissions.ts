// Permissions of this viewer: those of the connection, in the state of the session.

import { computed } from "@preact/signals-core";
import type { Connection } from "../protocol/connection.js";
import type { Session } from "./session.js";

export class Permissions {
  /** Whether this viewer may operate the device: stroke, pause, turn the object, rearm. */
  readonly operateTool = computed(
    () =>
      this.connection.allows("hand") &&
      !this.session.scene.value?.recording &&
      this.session.state.value?.lesson.of_another !== true,
  );
  /** Whether this viewer may change settings of the loop and contact properties. */
  readonly changeContact = computed(() => this.connection.allows("feel") && !this.session.scene.value?.recording);

  constructor(
    private readonly session: Session,
    private readonly connection: Connection,
  ) {}
}
