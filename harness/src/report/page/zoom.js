// Looks closer at all charts at once: drag across one. Nothing else on the page needs a script.
(() => {
  const SVG = "http://www.w3.org/2000/svg";
  const charts = [...document.querySelectorAll(".zoomable svg.chart")];
  if (!charts.length) return;
  const of = (chart, name) => Number(chart.dataset[name]);
  const whole = [of(charts[0], "from"), of(charts[0], "to")];
  if (!(whole[1] > whole[0])) return;
  let shown = whole;

  const bar = document.createElement("div");
  bar.id = "zoom";
  const words = document.createElement("span");
  const all = document.createElement("button");
  all.textContent = "show all";
  bar.append(words, all);
  document.getElementById("motion").append(bar);

  const element = (name, attributes, text) => {
    const made = document.createElementNS(SVG, name);
    for (const key in attributes) made.setAttribute(key, attributes[key]);
    if (text !== undefined) made.textContent = text;
    return made;
  };
  const ticks = (from, to) => {
    const rough = (to - from) / 12, power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map((n) => n * power).find((step) => step >= rough) || 10 * power;
    const digits = Math.max(0, -Math.floor(Math.log10(step)));
    const found = [];
    for (let n = Math.ceil(from / step - 1e-9); n * step <= to * (1 + 1e-12); n++) found.push([n * step, (n * step).toFixed(digits)]);
    return found;
  };

  function show(from, to) {
    shown = [Math.max(whole[0], from), Math.min(whole[1], to)];
    const [a, b] = shown, share = (time) => (time - whole[0]) / (whole[1] - whole[0]);
    for (const chart of charts) {
      for (const data of chart.querySelectorAll("svg.data")) {
        data.dataset.size ??= data.getAttribute("viewBox");
        const [, , width, height] = data.dataset.size.split(" ").map(Number);
        data.setAttribute("viewBox", `${share(a) * width} 0 ${(share(b) - share(a)) * width} ${height}`);
      }
      const time = chart.querySelector(".time"), height = Number(time.dataset.height);
      const marks = ticks(a, b).flatMap(([at, text]) => {
        const x = of(chart, "left") + ((at - a) / (b - a)) * of(chart, "along");
        return [element("path", { d: `M${x} 0V${height + 4}` }), element("text", { x, y: height + 17 }, text)];
      });
      time.replaceChildren(...marks);
    }
    const closer = b - a < whole[1] - whole[0];
    words.textContent = closer
      ? `shown: ${a.toFixed(3)} s to ${b.toFixed(3)} s`
      : "Drag across a chart to look closer at all of them; a double click shows all.";
    all.hidden = !closer;
  }

  let drag = null;
  const place = (chart, event) => {
    const box = chart.getBoundingClientRect();
    const x = ((event.clientX - box.left) / box.width) * chart.viewBox.baseVal.width - of(chart, "left");
    return Math.min(1, Math.max(0, x / of(chart, "along")));
  };
  for (const chart of charts) {
    chart.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || event.pointerType === "touch" || drag) return;
      const pick = element("rect", { class: "pick", y: 0, height: chart.querySelector(".time").dataset.height });
      chart.append(pick);
      drag = { chart, pick, start: place(chart, event) };
      event.preventDefault();
    });
    chart.addEventListener("dblclick", () => show(...whole));
  }
  addEventListener("pointermove", (event) => {
    if (!drag) return;
    const end = place(drag.chart, event), along = of(drag.chart, "along");
    drag.pick.setAttribute("x", of(drag.chart, "left") + Math.min(drag.start, end) * along);
    drag.pick.setAttribute("width", Math.abs(end - drag.start) * along);
  });
  addEventListener("pointerup", (event) => {
    if (!drag) return;
    const [a, b] = [drag.start, place(drag.chart, event)].sort((a, b) => a - b), [from, to] = shown;
    drag.pick.remove();
    drag = null;
    if (b - a > 0.004) show(from + a * (to - from), from + b * (to - from));
  });
  addEventListener("pointercancel", () => {
    drag?.pick.remove();
    drag = null;
  });
  all.addEventListener("click", () => show(...whole));
  document.addEventListener("keydown", (event) => event.key === "Escape" && show(...whole));
  show(...whole);
})();
