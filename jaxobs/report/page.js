"use strict";
// Draws every chart of the page from the JSON beside it. "plot": a plotly figure. "study": metrics on named axes, with selectors.
(function () {
  const config = { displayModeBar: window.innerWidth < 600 ? false : "hover",
    responsive: true, displaylogo: false, modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"] };
  const narrow = () => window.innerWidth < 600;

  function plot(holder, figure) {
    Plotly.newPlot(holder, figure.data, figure.layout, config);
  }

  function select(controls, name, options, chosen, changed) {
    const label = document.createElement("label");
    const menu = document.createElement("select");
    label.append(name, menu);
    options.forEach((text, i) => menu.add(new Option(text, String(i), false, i === chosen)));
    menu.addEventListener("change", changed);
    controls.append(label);
    return { label, menu, get value() { return Number(menu.value); } };
  }

  function study(holder, ds) {
    const controls = document.createElement("div");
    controls.className = "controls";
    holder.before(controls);
    const redraw = () => draw();
    const names = ds.metrics.map((metric) => metric.name);
    const metric = select(controls, "metric", names, 0, () => { fillPart(); draw(); });
    const part = select(controls, "of", [], 0, redraw);
    const view = ds.axes.length > 1 ? select(controls, "as", ["curves", "heat map"], 0, redraw) : null;
    const across = ds.axes.length ? select(controls, "across", ds.axes.map((axis) => axis.name), ds.across, redraw) : null;
    const lines = ds.axes.length > 1
      ? select(controls, "lines or rows", ds.axes.map((axis) => axis.name), ds.lines, redraw) : null;
    const fixed = ds.axes.map((axis) => select(controls, axis.name, axis.labels, 0, redraw));

    function fillPart() {
      const own = ds.metrics[metric.value];
      part.menu.replaceChildren(...own.parts.map((text, i) => new Option(text || "all", String(i))));
      part.label.style.display = own.parts.length > 1 ? "" : "none";
      part.menu.value = String(own.parts.length - 1);
    }

    // quantile k of the chosen metric at the point `at` (one place an axis)
    function value(own, k, at) {
      let index = 0;
      ds.axes.forEach((axis, i) => { index = index * axis.labels.length + at[i]; });
      return own.quantiles[k][index * own.parts.length + part.value];
    }

    function draw() {
      const own = ds.metrics[metric.value];
      const x = across ? across.value : -1;
      let rows = lines ? lines.value : -1;
      if (rows === x) { rows = ds.axes.findIndex((axis, i) => i !== x); lines.menu.value = String(rows); }
      fixed.forEach((one, i) => { one.label.style.display = i === x || i === rows ? "none" : ""; });
      const at = fixed.map((one) => one.value);
      const place = (i, j) => at.map((k, axis) => (axis === x ? i : axis === rows ? j : k));
      const title = own.label + (own.parts[part.value] ? " of " + own.parts[part.value] : "") + own.units;
      const many = x < 0 ? [""] : ds.axes[x].labels;
      const members = rows < 0 ? [""] : ds.axes[rows].labels;
      const layout = structuredClone(ds.layout);
      layout.height = narrow() ? 380 : 460;
      if (view && view.value === 1) return heat(own, title, many, members, place, layout, x, rows);
      const numeric = x >= 0 && ds.axes[x].values !== null;
      const xs = numeric ? ds.axes[x].values : many;
      const data = [];
      members.forEach((name, j) => {
        const q = [0, 1, 2].map((k) => many.map((_, i) => value(own, k, place(i, j))));
        const colour = ds.colours[j % ds.colours.length];
        const label = rows < 0 ? title : ds.axes[rows].name + " = " + name;
        if (ds.seeds > 1) {
          // A band is a closed outline for each stretch without a gap.
          const band = { x: [], y: [] };
          for (let from = 0, to = 0; from < many.length; from = to + 1) {
            for (to = from; to < many.length && q[0][to] !== null && q[2][to] !== null;) to += 1;
            const good = many.slice(from, to).map((_, i) => from + i), back = good.slice().reverse();
            band.x.push(...good.map((i) => xs[i]), ...back.map((i) => xs[i]), null);
            band.y.push(...good.map((i) => q[0][i]), ...back.map((i) => q[2][i]), null);
          }
          data.push({ x: band.x, type: "scatter", mode: "lines", fill: "toself", y: band.y, fillcolor: colour, opacity: 0.18,
            line: { width: 0 }, hoverinfo: "skip", showlegend: false, legendgroup: label });
        }
        data.push({ x: xs, y: q[1], name: label, legendgroup: label, type: "scatter", mode: "lines+markers",
          line: { color: colour, dash: ds.dashes[(j + Math.floor(j / ds.colours.length)) % ds.dashes.length] }, marker: { symbol: ds.symbols[j % ds.symbols.length] },
          customdata: many.map((_, i) => [q[0][i], q[2][i]]),
          hovertemplate: "%{y:.4g}" + (ds.seeds > 1 ? " (5 to 95 %: %{customdata[0]:.4g} to %{customdata[1]:.4g})" : "") });
      });
      const all = data.flatMap((trace) => trace.y).filter((y) => y !== null);
      const wide = (v) => v.length > 0 && Math.min(...v) > 0 && Math.max(...v) > 4 * Math.min(...v);
      const scale = (v) => !wide(v) ? { type: "linear" } : Math.max(...v) < 1000 * Math.min(...v) ? { type: "log", dtick: "D2" } : { type: "log" };
      layout.xaxis = { ...layout.xaxis, title: { text: x < 0 ? "" : ds.axes[x].name }, ...(numeric ? scale(xs) : { type: "category" }) };
      if (numeric && xs.length <= 10) Object.assign(layout.xaxis, { tickmode: "array", tickvals: xs, ticktext: many });
      layout.yaxis = { ...layout.yaxis, title: { text: title }, ...scale(all) };
      layout.showlegend = members.length > 1;
      layout.margin = { ...layout.margin, b: 64 + (members.length > 1 ? 22 * Math.ceil(members.length / (narrow() ? 2 : 7)) : 0) };
      Plotly.react(holder, data, layout, config);
    }

    function heat(own, title, many, members, place, layout, x, rows) {
      const z = members.map((_, j) => many.map((_, i) => value(own, 1, place(i, j))));
      const flat = z.flat().filter((v) => v !== null);
      const logarithmic = flat.length > 0 && Math.min(...flat) > 0 && Math.max(...flat) > 4 * Math.min(...flat);
      const data = [{ type: "heatmap", x: many, y: members, z: z.map((row) => row.map((v) => (v !== null && logarithmic ? Math.log10(v) : v))),
        customdata: z.map((row, j) => row.map((v, i) => [v, value(own, 0, place(i, j)), value(own, 2, place(i, j))])), hoverongaps: false,
        hovertemplate: ds.axes[x].name + " = %{x}<br>" + ds.axes[rows].name + " = %{y}<br>%{customdata[0]:.4g}"
          + (ds.seeds > 1 ? "<br>5 to 95 %: %{customdata[1]:.4g} to %{customdata[2]:.4g}" : "") + "<extra></extra>",
        text: z.map((row) => row.map((v) => (v === null ? "" : String(Number(v.toPrecision(3)))))),
        texttemplate: many.length <= (narrow() ? 5 : 12) ? "%{text}" : "", colorscale: ds.scale,
        showscale: false, xgap: 1, ygap: 1 }];
      if (flat.length) {
        const least = Math.min(...flat);
        const j = z.findIndex((row) => row.includes(least)), i = z[j].indexOf(least);
        layout.shapes = [{ type: "rect", x0: i - 0.5, x1: i + 0.5, y0: j - 0.5, y1: j + 0.5, line: { color: ds.mark, width: 3 } }];
      }
      layout.xaxis = { ...layout.xaxis, type: "category", title: { text: ds.axes[x].name } };
      layout.yaxis = { ...layout.yaxis, type: "category", title: { text: ds.axes[rows].name } };
      layout.title = { text: "median " + title + ", the least framed", font: { size: 13 }, x: 0.01 };
      layout.margin = { ...layout.margin, t: 40 };
      Plotly.react(holder, data, layout, config);
    }

    fillPart();
    draw();
  }

  const kinds = { plot, study };
  for (const holder of document.querySelectorAll("[data-kind]")) {
    kinds[holder.dataset.kind](holder, JSON.parse(document.getElementById(holder.dataset.source).textContent));
  }

  // Paper has its own width.
  const all = () => document.querySelectorAll(".chart");
  window.addEventListener("beforeprint", () => all().forEach((one) => Plotly.relayout(one, { width: 660, autosize: false })));
  window.addEventListener("afterprint", () => all().forEach((one) => Plotly.relayout(one, { width: null, autosize: true })));
})();
