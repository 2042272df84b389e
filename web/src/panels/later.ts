// Panels that the first section does not need, in a module of their own that is fetched after it.

export { Bookmarks } from "./bookmarks.js";
export { BurrControls } from "./burr_controls.js";
export { FeelPanel } from "./feel.js";
export { LoopPlots } from "./loop_plots.js";
export { showPress } from "./press.js";
export { StructuresPanel } from "./structures_panel.js";
export { showTracked } from "./tracked.js";
