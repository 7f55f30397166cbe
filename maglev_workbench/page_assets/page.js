// Draws the figures of a page when they come into view, in the colours of the reader, and saves what they show.

(() => {
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const { arrays, figures } = JSON.parse(document.getElementById("figures").textContent);
  const places = figures.map((_, i) => document.getElementById(`figure-${i + 1}`));
  const drawn = new Set(), NARROW = 600; // px
  const COLOURWAY = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#882255", "#999999"];

  function template() {
    const [ground, ink, grid] = dark.matches ? ["#16181c", "#e6e6e6", "#2c2f36"] : ["#fff", "#2a3f5f", "#e9edf4"];
    const axis = { gridcolor: grid, zerolinecolor: grid, zerolinewidth: 2, automargin: true, title: { standoff: 15 } };
    const bar = { outlinewidth: 0, ticks: "" };
    return {
      layout: {
        font: { color: ink }, paper_bgcolor: ground, plot_bgcolor: ground, colorway: COLOURWAY, hovermode: "closest",
        autotypenumbers: "strict", hoverlabel: { align: "left" }, xaxis: axis, yaxis: axis, coloraxis: { colorbar: bar },
        annotationdefaults: { arrowcolor: ink, arrowhead: 0, arrowwidth: 1 }, shapedefaults: { line: { color: ink } },
      },
      data: { heatmap: [{ colorbar: bar }] },
    };
  }

  // Arrays are written once on a page, however many traces have them.
  const resolved = (value) => {
    if (Array.isArray(value)) return value.map(resolved);
    if (value === null || typeof value !== "object") return value;
    if ("array_number" in value) return { ...arrays[value.array_number] };
    return Object.fromEntries(Object.entries(value).map(([key, one]) => [key, resolved(one)]));
  };

  // Greys that are chosen for paper change places with those for a dark screen; colours stay.
  const GREY = /^#([0-9a-f])(?:\1\1|([0-9a-f])\1\2\1\2)$/i, NAMED = { black: 0, white: 255 };
  function turned(value, key) {
    if (Array.isArray(value)) return value.map((one) => turned(one, key));
    if (typeof value === "object" && value !== null)
      return Object.fromEntries(Object.entries(value).map(([k, one]) => [k, turned(one, k)]));
    if (typeof value !== "string" || !/color$/.test(key)) return value;
    const hex = GREY.exec(value);
    if (!hex && !(value in NAMED)) return value;
    const level = hex ? parseInt(hex[1] + (hex[2] || hex[1]), 16) : NAMED[value];
    const other = Math.round(24 + (255 - level) * 0.87);
    return `rgb(${other},${other},${other})`;
  }

  // A name in lines of at most LINE characters, where its words allow it.
  const LINE = 40;
  const broken = (name) => name.split(" ").reduce(([lines, last], word) =>
    (last && last.length + word.length >= LINE ? [[...lines, last], word] : [lines, last ? `${last} ${word}` : word]), [[], ""]).flat().join("<br>");

  function shown(i) {
    const { data, layout } = resolved(figures[i]);
    // What lies on a map stands out from the map's colours, which are the same on every screen.
    const asIs = !dark.matches || data.some((trace) => trace.type === "heatmap");
    const fitted = { ...(dark.matches ? turned(layout) : layout), template: template() };
    const above = layout.title || layout.legend?.y >= 1 || layout.annotations?.some((one) => one.yref === "paper" && one.y > 0.9);
    if (!above) fitted.margin = { ...layout.margin, t: 20 };
    // A legend at the side leaves no room for the figure on a narrow screen, and long names have none above it.
    const narrow = places[i].clientWidth < NARROW;
    if (narrow) for (const trace of data) if (trace.name) trace.name = broken(trace.name);
    if (narrow && !(layout.legend?.y > 0 && layout.legend.y < 1))
      fitted.legend = { ...layout.legend, orientation: "h", x: 0, xanchor: "left", y: -95 / (layout.height || 450), yanchor: "top" };
    return { data: asIs ? data : turned(data), layout: fitted };
  }

  function draw(i) {
    const { data, layout } = shown(i);
    Plotly.react(places[i], data, layout, { displaylogo: false, responsive: true });
    drawn.add(i);
  }
  const rest = () => figures.forEach((_, i) => drawn.has(i) || draw(i));

  async function start() {
    const packed = atob(document.getElementById("plotly").textContent.trim());
    const bytes = new Uint8Array(packed.length);
    for (let i = 0; i < packed.length; i++) bytes[i] = packed.charCodeAt(i);
    const unpacked = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    const script = document.createElement("script");
    script.textContent = await new Response(unpacked).text();
    document.head.append(script);
    const near = new IntersectionObserver((seen) => {
      for (const one of seen) {
        const i = places.indexOf(one.target);
        if (one.isIntersecting && !drawn.has(i)) draw(i);
      }
    }, { rootMargin: "50px" });
    places.forEach((place) => near.observe(place));
    addEventListener("beforeprint", rest);
    dark.addEventListener("change", () => drawn.forEach(draw));
    document.body.dataset.ready = figures.length;
  }

  const quoted = (cell) => (/[",\n]/.test(cell) ? `"${cell.replaceAll('"', '""')}"` : cell);
  const written = (value) => (typeof value === "number" ? String(Number(value.toPrecision(7))) : String(value ?? ""));
  function save(rows, name) {
    const link = document.createElement("a");
    const text = rows.map((row) => row.map((cell) => quoted(written(cell))).join(",")).join("\n");
    link.href = URL.createObjectURL(new Blob([`${text}\n`], { type: "text/csv" }));
    link.download = `${document.title}, ${name}.csv`.replace(/[^\w ,.-]/g, "_");
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }

  function figureRows(i) {
    if (!drawn.has(i)) draw(i);
    const { _fullData: traces, _fullLayout: layout } = places[i];
    const title = (trace, axis) => {
      const id = trace[`${axis}axis`] || axis;
      return layout[id.replace(axis, `${axis}axis`)]?.title?.text?.replace(/<[^>]*>/g, " ") || "";
    };
    const rows = [["trace", "x axis", "y axis", "x", "y", "z"]];
    for (const trace of traces) {
      const head = [trace.name?.replaceAll("<br>", " "), title(trace, "x"), title(trace, "y")];
      const [x, y] = [trace.x, trace.y].map((values) => values && Array.from(values));
      if (trace.z) trace.z.forEach((row, at) => row.forEach((z, j) => rows.push([...head, x?.[j] ?? j, y?.[at] ?? at, z])));
      else y?.forEach((value, at) => rows.push([...head, x?.[at] ?? at, value, ""]));
    }
    return rows;
  }

  function offer(place, rows, name) {
    const button = document.createElement("button");
    button.textContent = "Save CSV";
    button.title = `Save the data of this ${name.split(" ")[0]}`;
    button.onclick = () => save(rows(), name);
    place.after(button);
  }
  places.forEach((place, i) => offer(place.closest(".scroll") || place, () => figureRows(i), `figure ${i + 1}`));
  document.querySelectorAll(".scroll > table").forEach((table, i) => {
    const rows = () => [...table.rows].map((row) => [...row.cells].map((cell) => cell.textContent.replaceAll("\n", " ")));
    offer(table.parentElement, rows, `table ${i + 1}`);
  });
  if (!figures.length) return;
  start().catch((error) => {
    places.forEach((place) => { place.textContent = `The figure cannot be drawn: ${error.message}`; });
    console.error(error);
  });
})();
