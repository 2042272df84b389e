"use strict";
(() => {
  const root = document.documentElement;
  const byId = (id) => document.getElementById(id);
  const colour = (name) => getComputedStyle(root).getPropertyValue("--" + name).trim();

  // ---- tabs: one contact at a time; on paper all of them ----
  const tabs = [...document.querySelectorAll("[role=tab]")];
  const panels = tabs.map((tab) => byId(tab.getAttribute("aria-controls")));
  let selected = 0;
  const select = (index, focus) => {
    selected = index;
    tabs.forEach((tab, i) => {
      tab.setAttribute("aria-selected", String(i === index));
      tab.tabIndex = i === index ? 0 : -1;
      panels[i].hidden = i !== index;
    });
    if (focus) tabs[index].focus();
    plots.forEach((plot) => plot.redraw(false));
  };
  const keys = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 };
  tabs.forEach((tab, i) => {
    tab.addEventListener("click", () => select(i, false));
    tab.addEventListener("keydown", (event) => {
      let next = -1;
      if (event.key in keys) next = (i + keys[event.key] + tabs.length) % tabs.length;
      if (event.key === "Home") next = 0;
      if (event.key === "End") next = tabs.length - 1;
      if (next < 0) return;
      event.preventDefault();
      select(next, true);
    });
  });

  // ---- what is drawn over the sections ----
  if (tabs.length > 0) {
    byId("structures").addEventListener("input", (event) => {
      root.style.setProperty("--structures", event.target.value / 100);
    });
    byId("marks").addEventListener("change", (event) => {
      root.classList.toggle("no-marks", !event.target.checked);
    });
    byId("strain")?.addEventListener("change", (event) => {
      root.classList.toggle("strained", event.target.checked);
    });
    byId("zoom-contact").addEventListener("click", () => {
      const begin = run.shown.begin[selected];
      const end = run.shown.end[selected];
      const margin = Math.max(0.25, 0.15 * (end - begin));
      zoom(begin - margin, end + margin);
      byId("plots-title").scrollIntoView({ behavior: "smooth", block: "start" });
    });
  }

  // ---- plots ----
  let plots = [];
  const block = byId("run-data");
  const run = block ? JSON.parse(block.textContent) : null;

  let zooming = false;
  const zoom = (min, max) => {
    if (zooming) return;
    zooming = true;
    for (const plot of plots) {
      const { x } = plot.scales;
      if (x.min !== min || x.max !== max) plot.setScale("x", { min, max });
    }
    zooming = false;
  };

  // contacts behind the curves: a tint and a bar in the structure's colour, the selected one stronger;
  // named where the name fits
  const shadeContacts = (plot, named) => {
    const { ctx, bbox } = plot;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    const pixel = devicePixelRatio;
    ctx.font = 11 * pixel + "px system-ui, sans-serif";
    run.contacts.forEach((contact, i) => {
      const left = plot.valToPos(contact.begin, "x", true);
      const width = Math.max(pixel, plot.valToPos(contact.end, "x", true) - left);
      const isChosen = contact.begin === run.shown.begin[selected] && contact.end === run.shown.end[selected];
      ctx.fillStyle = contact.colour;
      ctx.globalAlpha = isChosen ? 0.34 : 0.16;
      ctx.fillRect(left, bbox.top, width, bbox.height);
      ctx.globalAlpha = 1;
      ctx.fillRect(left, bbox.top, width, 4 * pixel);
      ctx.strokeStyle = colour("line");  // so that a white structure shows on a white card
      ctx.lineWidth = pixel;
      ctx.strokeRect(left, bbox.top, width, 4 * pixel);
      if (!named) return;
      const next = run.contacts[i + 1];
      const end = next ? plot.valToPos(next.begin, "x", true) : bbox.left + bbox.width;
      if (ctx.measureText(contact.name).width > end - left - 6 * pixel) return;
      ctx.fillStyle = colour("muted");
      ctx.fillText(contact.name, left + 3 * pixel, bbox.top + 16 * pixel);
    });
    ctx.restore();
  };

  const axis = (extra) => ({
    stroke: colour("muted"),
    font: "12px system-ui, sans-serif",
    grid: { stroke: colour("line"), width: 1 },
    ticks: { stroke: colour("line"), width: 1, size: 4 },
    ...extra,
  });

  const touchedAt = (time) => run.contacts
    .filter((contact) => contact.begin <= time && time < contact.end)
    .map((contact) => contact.name);
  const showTime = (_, time) => time == null ? "-" : [time.toFixed(3) + " s", ...touchedAt(time)].join(", ");
  const show = (decimals, unit) => (_, value) => value == null ? "-" : value.toFixed(decimals) + " " + unit;

  const dashes = [[], [6, 3], [2, 3], [8, 3, 2, 3]];
  // one curve a device
  const curves = (name, decimals, unit) => run[name].map((_, i) => ({
    label: run[name].length > 1 ? "Device " + (i + 1) : name[0].toUpperCase() + name.slice(1),
    stroke: colour(name),
    width: 1.4,
    dash: dashes[i],
    points: { show: false },
    value: show(decimals, unit),
  }));

  // a structure's colour, as much darker or lighter as a curve must be to be seen on the card (WCAG: 3 to 1)
  const channels = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));
  const luminance = (rgb) => rgb
    .map((c) => (c / 255 <= 0.04045 ? c / 255 / 12.92 : ((c / 255 + 0.055) / 1.055) ** 2.4))
    .reduce((sum, c, i) => sum + c * [0.2126, 0.7152, 0.0722][i], 0);
  const legible = (hex) => {
    const own = channels(hex), ink = channels(colour("ink")), card = luminance(channels(colour("card"))) + 0.05;
    let mixed = own;
    for (let part = 0; part <= 1; part += 0.05) {
      mixed = own.map((c, i) => Math.round(c + part * (ink[i] - c)));
      const contrast = (luminance(mixed) + 0.05) / card;
      if (Math.max(contrast, 1 / contrast) >= 3) break;
    }
    return "rgb(" + mixed.join() + ")";
  };
  const ofStructures = (structures, decimals, unit) => structures.map((structure, i) => ({
    label: structure.name,
    stroke: legible(structure.colour),
    width: 1.4,
    dash: dashes[i % dashes.length],
    points: { show: false },
    value: show(decimals, unit),
  }));
  // one curve a structure, which stays until more of it is gone
  const removals = () => run.removedOf.map((structure, i) => ({
    label: structure.name,
    stroke: legible(structure.colour),
    width: 1.8,
    dash: dashes[i % dashes.length],
    paths: uPlot.paths.stepped({ align: 1 }),
    points: { show: false },
    value: (_, mm3) => mm3 == null ? "-" : mm3.toFixed(mm3 < 10 ? 2 : mm3 < 100 ? 1 : 0) + " mm\u00b3",
  }));

  const makePlot = (name, series, data, range) => {
    const place = byId("plot-" + name);
    const options = {
      width: place.clientWidth,
      height: 190,
      padding: [10, 8, 0, 0],
      scales: { x: { time: false }, y: { range } },
      axes: [
        axis({ values: (_, ticks) => ticks.map((t, i) => +t.toFixed(3) + (i === ticks.length - 1 ? " s" : "")), size: 32 }),
        axis({ size: 52 }),
      ],
      series: [{ label: "Time", value: showTime }, ...series],
      cursor: {
        drag: { x: true, y: false },
        sync: { key: "run", filters: { pub: (type) => type === "mousemove" || type === "mouseleave" } },
        points: { size: 7 },
      },
      hooks: {
        drawClear: [(plot) => shadeContacts(plot, name === "force")],
        setScale: [(plot, key) => { if (key === "x") zoom(plot.scales.x.min, plot.scales.x.max); }],
      },
    };
    return new uPlot(options, [run.time, ...data], place);
  };

  // zero always in sight; some room at the ends that are not zero
  const withZero = (room) => (_, min, max) => {
    const low = Math.min(0, min ?? 0), high = Math.max(0, max ?? 0), span = high - low || 1;
    return [low < 0 ? low - 0.06 * span : 0, high + room * span];
  };
  const drawPlots = () => {
    const shown = plots.length > 0 ? { ...plots[0].scales.x } : null;
    plots.forEach((plot) => plot.destroy());
    plots = [];
    if (run === null) return;
    const limits = run.limit.map((_, i) => ({
      label: run.limit.length > 1 ? "Limit " + (i + 1) : "Limit",
      stroke: colour("limit"),
      width: 1.4,
      dash: [7, 4],
      points: { show: false },
      value: show(2, "N"),
    }));
    plots = [
      makePlot("force", [...curves("force", 3, "N"), ...limits], [...run.force, ...run.limit], withZero(0.3)),
      makePlot("depth", curves("depth", 3, "mm"), run.depth, withZero(0.1)),
      makePlot("speed", curves("speed", 1, "mm/s"), run.speed, withZero(0.1)),
    ];
    // where tissue yields
    if (run.layers) {
      plots.push(makePlot("layer-force", ofStructures(run.layers, 3, "N"), run.layerForce, withZero(0.1)));
      plots.push(makePlot("layer-depth", ofStructures(run.layers, 2, "mm"), run.layerDepth, withZero(0.1)));
    }
    // where a burr was at work
    if (run.removed) plots.push(makePlot("removed", removals(), run.removed, withZero(0.1)));
    // beside a plan
    if (run.clearance) plots.push(makePlot("clearance", ofStructures(run.clearanceOf, 2, "mm"), run.clearance, withZero(0.1)));
    // on the real clock
    if (run.lateness) plots.push(makePlot("lateness", curves("lateness", 1, "\u00b5s"), run.lateness, withZero(0.1)));
    if (shown) zoom(shown.min, shown.max);
  };

  const resize = (width) => plots.forEach((plot) => plot.setSize({ width, height: 190 }));

  drawPlots();
  if (tabs.length > 0) select(0, false);
  if (run !== null) {
    new ResizeObserver(([entry]) => resize(Math.floor(entry.contentRect.width))).observe(byId("plot-force"));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawPlots);
    // paper is light and narrow
    addEventListener("beforeprint", () => {
      root.classList.add("printing");
      drawPlots();
      resize(680);
    });
    addEventListener("afterprint", () => {
      root.classList.remove("printing");
      drawPlots();
    });
  }
})();
