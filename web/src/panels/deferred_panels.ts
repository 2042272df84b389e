// Panels loaded after the first section has been drawn (one chunk).

export { addObliqueHead } from "../section/oblique_head.js";
export { Bookmarks } from "./bookmarks.js";
export { BurrControls } from "./burr_controls.js";
export { DisplayPanel } from "./display_panel.js";
export { HapticsPanel } from "./haptics_panel.js";
export { LoopPlots } from "./loop_plots.js";
export { showPress } from "./press.js";
export { StructuresPanel } from "./structures_panel.js";
export { showTracked } from "./tracked.js";
