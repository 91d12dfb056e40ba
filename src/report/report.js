"use strict";

// The picture viewer. One state for all frames: scale in CSS pixels per image pixel (0 fits the
// frame) and the image coordinate at the centre of every frame, so that all of them move together.
for (const viewer of document.querySelectorAll(".viewer")) {
  const stage = viewer.querySelector(".stage");
  const figures = [...stage.querySelectorAll("figure")];
  const frames = figures.map((figure) => figure.querySelector(".frame"));
  const images = frames.map((frame) => frame.querySelector("img"));
  const find = (selector) => viewer.querySelector(selector);
  const [columns, rows] = [images[0].getAttribute("width"), images[0].getAttribute("height")].map(Number);
  const place = viewer.dataset.place ? viewer.dataset.place.split(" ").map(Number) : null;
  const steps = [1, 2, 3, 4, 6, 8, 12, 16, 24, 32];
  // A narrow window has no room for two pictures, so it starts with one that a tap flips.
  const state = { mode: stage.clientWidth < 600 ? "flip" : "side", shown: 0, scale: 0, x: columns / 2, y: rows / 2, marked: false };
  const keys = figures.map((figure) => figure.dataset.key);
  const ours = keys.indexOf("ours");
  const reference = keys.indexOf("reference");
  const marks = frames.map((frame) => {
    const mark = document.createElement("span");
    mark.className = "mark";
    mark.hidden = true;
    frame.append(mark);
    return mark;
  });
  let held = null;

  const visible = () => frames[state.mode === "flip" ? state.shown : 0];
  const fitted = (frame) => frame.clientWidth / columns;
  const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

  function draw() {
    viewer.classList.toggle("flipping", state.mode === "flip");
    figures.forEach((figure, index) => figure.classList.toggle("shown", index === state.shown));
    const smallest = fitted(visible());
    if (state.scale && state.scale <= smallest) state.scale = 0;
    viewer.classList.toggle("zoomed", state.scale > 0);
    const snap = (value) => Math.round(value * devicePixelRatio) / devicePixelRatio;
    frames.forEach((frame, index) => {
      if (!frame.clientWidth) return;
      const fit = fitted(frame);
      const scale = Math.max(state.scale, fit);
      const [halfWidth, halfHeight] = [frame.clientWidth / scale / 2, frame.clientHeight / scale / 2];
      const left = clamp(state.x, halfWidth, columns - halfWidth) - halfWidth;
      const top = clamp(state.y, halfHeight, rows - halfHeight) - halfHeight;
      const [shiftX, shiftY] = state.scale ? [snap(left * scale), snap(top * scale)] : [0, 0];
      images[index].style.transform = `translate(${-shiftX}px, ${-shiftY}px) scale(${scale / fit})`;
      const mark = marks[index];
      mark.hidden = !state.marked;
      if (state.marked) {
        const size = Math.max(scale, 7);
        mark.style.left = `${(place[0] + 0.5) * scale - shiftX - size / 2}px`;
        mark.style.top = `${(place[1] + 0.5) * scale - shiftY - size / 2}px`;
        mark.style.width = mark.style.height = `${size}px`;
      }
    });
    find(".scale").textContent = state.scale ? `${state.scale}:1` : "fit";
    for (const button of viewer.querySelectorAll("[data-mode]")) {
      button.setAttribute("aria-pressed", button.dataset.mode === state.mode);
    }
    for (const button of viewer.querySelectorAll("[data-pick]")) {
      button.setAttribute("aria-pressed", state.mode === "flip" && Number(button.dataset.pick) === state.shown);
    }
  }

  function pick(index) {
    if (index < 0 || index >= figures.length) return;
    state.mode = "flip";
    state.shown = index;
    draw();
  }

  function flip() {
    if (ours < 0 || reference < 0) return;
    pick(state.mode === "flip" && state.shown === ours ? reference : ours);
  }

  function zoom(direction) {
    const smallest = fitted(visible());
    const now = state.scale || smallest;
    const larger = steps.filter((step) => step > now * 1.001 && step > smallest);
    const smaller = steps.filter((step) => step < now * 0.999 && step > smallest);
    state.scale = direction > 0 ? (larger[0] ?? now) : (smaller.at(-1) ?? 0);
    draw();
  }

  function pan(dx, dy) {
    const frame = visible();
    if (!state.scale) return;
    const [halfWidth, halfHeight] = [frame.clientWidth / state.scale / 2, frame.clientHeight / state.scale / 2];
    state.x = clamp(state.x + dx / state.scale, halfWidth, columns - halfWidth);
    state.y = clamp(state.y + dy / state.scale, halfHeight, rows - halfHeight);
    draw();
  }

  // The image coordinate under a pointer.
  function under(frame, event) {
    const box = images[frames.indexOf(frame)].getBoundingClientRect();
    return [((event.clientX - box.left) / box.width) * columns, ((event.clientY - box.top) / box.height) * rows];
  }

  function zoomAt(frame, event, direction) {
    const [x, y] = under(frame, event);
    zoom(direction);
    if (state.scale) {
      const box = frame.getBoundingClientRect();
      state.x = x - (event.clientX - box.left - box.width / 2) / state.scale;
      state.y = y - (event.clientY - box.top - box.height / 2) / state.scale;
      pan(0, 0);
    }
  }

  const pointers = new Map();
  let spread = 0;
  const distance = () => {
    const [a, b] = [...pointers.values()];
    return Math.hypot(a.x - b.x, a.y - b.y);
  };
  for (const frame of frames) {
    frame.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      pointers.set(event.pointerId, { x: event.clientX, y: event.clientY, moved: 0 });
      if (pointers.size === 2) spread = distance();
      if (state.scale) frame.setPointerCapture(event.pointerId);
    });
    frame.addEventListener("pointermove", (event) => {
      const [x, y] = under(frame, event).map(Math.floor);
      find(".readout").textContent = x >= 0 && y >= 0 && x < columns && y < rows ? `x ${x}, y ${y}` : "";
      const last = pointers.get(event.pointerId);
      if (!last) return;
      const [dx, dy] = [event.clientX - last.x, event.clientY - last.y];
      pointers.set(event.pointerId, { x: event.clientX, y: event.clientY, moved: last.moved + Math.hypot(dx, dy) });
      if (pointers.size === 2) {
        const now = distance();
        if (now > spread * 1.3 || now < spread / 1.3) {
          zoom(now - spread);
          spread = now;
        }
      } else {
        pan(-dx, -dy);
      }
    });
    frame.addEventListener("pointerup", (event) => {
      const last = pointers.get(event.pointerId);
      pointers.delete(event.pointerId);
      if (last && last.moved < 4 && state.mode === "flip" && !pointers.size) flip();
    });
    frame.addEventListener("pointercancel", (event) => pointers.delete(event.pointerId));
    frame.addEventListener("pointerleave", (event) => {
      find(".readout").textContent = "";
      if (!state.scale) pointers.delete(event.pointerId);
    });
    frame.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.metaKey) return;
      event.preventDefault();
      zoomAt(frame, event, -event.deltaY);
    }, { passive: false });
    frame.addEventListener("dblclick", (event) => {
      if (state.mode === "side") zoomAt(frame, event, 1);
    });
  }

  stage.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const far = visible().clientWidth / 8;
    const actions = {
      f: flip, F: flip, s: () => { state.mode = "side"; draw(); },
      "+": () => zoom(1), "=": () => zoom(1), "-": () => zoom(-1), 0: () => { state.scale = 0; draw(); },
      ArrowLeft: () => pan(-far, 0), ArrowRight: () => pan(far, 0), ArrowUp: () => pan(0, -far), ArrowDown: () => pan(0, far),
      " ": () => { if (held === null && reference >= 0) { held = { mode: state.mode, shown: state.shown }; pick(reference); } },
    };
    const arrow = event.key.startsWith("Arrow");
    const digit = "123456789".indexOf(event.key);
    if (arrow && !state.scale) return;
    if (digit >= 0) pick(digit);
    else if (actions[event.key]) actions[event.key]();
    else return;
    event.preventDefault();
  });
  const release = (event) => {
    if (held === null || (event.type === "keyup" && event.key !== " ")) return;
    Object.assign(state, held);
    held = null;
    draw();
  };
  stage.addEventListener("keyup", release);
  stage.addEventListener("blur", release);

  viewer.addEventListener("click", (event) => {
    const button = event.target.closest("button");
    if (!button) return;
    if (button.dataset.mode) {
      state.mode = button.dataset.mode;
      draw();
    } else if (button.dataset.pick) {
      pick(Number(button.dataset.pick));
    } else if (button.dataset.zoom === "fit") {
      state.scale = 0;
      state.marked = false;
      draw();
    } else if (button.dataset.zoom) {
      zoom(Number(button.dataset.zoom));
    } else if (place) {
      state.marked = true;
      [state.x, state.y] = [place[0] + 0.5, place[1] + 0.5];
      state.scale = Math.max(8, steps.find((step) => step > fitted(visible())) ?? 32);
      draw();
    }
  });
  find("[data-goto]").hidden = !place;
  find(".toolbar").hidden = false;
  find(".hint").hidden = false;
  new ResizeObserver(draw).observe(stage);
  draw();
}

// The search over the node modes.
for (const filter of document.querySelectorAll(".filter")) {
  const rows = [...filter.parentElement.querySelectorAll("tbody tr")].map((row) => [row, row.textContent.toLowerCase()]);
  const [search, only, result] = [...filter.querySelectorAll("input, output")];
  function apply() {
    const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
    let shown = 0;
    for (const [row, text] of rows) {
      row.hidden = !words.every((word) => text.includes(word)) || (only.checked && !("open" in row.dataset));
      if (!row.hidden) shown += 1;
    }
    result.textContent = `${shown} of ${rows.length}`;
  }
  filter.addEventListener("input", apply);
  filter.hidden = false;
  apply();
}
