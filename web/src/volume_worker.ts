// The volume's pictures beside the page.

import { serve, type Answered, type Port } from "./volume_service.js";

const port = self as unknown as Port;
if (typeof OffscreenCanvas === "undefined") port.postMessage({ type: "unable", why: "no OffscreenCanvas" } satisfies Answered, []);
else serve(port, new OffscreenCanvas(64, 64));
