"use strict";
// Paths in space on a canvas: drag to turn, pinch or + and - to scale, double-click or 0 to begin again.
function show(figure) {
  const space = JSON.parse(figure.querySelector("script").textContent);
  const canvas = document.createElement("canvas");
  const brush = canvas.getContext("2d");
  if (!brush) return;
  canvas.tabIndex = 0;
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", "The path in space; arrow keys turn it.");
  figure.append(canvas);
  figure.classList.add("live");
  let [azimuth, elevation] = space.eye, zoom = 1, waiting = false;
  const fingers = new Map();

  function draw() {
    waiting = false;
    const wide = canvas.clientWidth, high = wide * space.aspect, sharp = window.devicePixelRatio || 1;
    if (!wide) return;
    canvas.width = Math.round(wide * sharp);
    canvas.height = Math.round(high * sharp);
    brush.setTransform(sharp, 0, 0, sharp, 0, 0);
    brush.clearRect(0, 0, wide, high);
    const look = getComputedStyle(figure), color = (name) => look.getPropertyValue("--" + name).trim();
    const sa = Math.sin(azimuth), ca = Math.cos(azimuth), se = Math.sin(elevation), ce = Math.cos(elevation);
    const scale = zoom * Math.min(wide, high) / (2 * space.radius), [cx, cy, cz] = space.centre;
    const place = (x, y, z) => [
      wide / 2 + scale * (-sa * (x - cx) + ca * (y - cy)),
      high / 2 - scale * (-se * (ca * (x - cx) + sa * (y - cy)) + ce * (z - cz)),
    ];
    function line(points, name, width, alpha, flat) {
      brush.strokeStyle = color(name);
      brush.lineWidth = width;
      brush.globalAlpha = alpha;
      brush.beginPath();
      for (let i = 0; i < points.length; i += 3)
        brush.lineTo(...place(points[i], points[i + 1], flat ? space.height : points[i + 2]));
      brush.stroke();
      brush.globalAlpha = 1;
    }
    brush.lineJoin = brush.lineCap = "round";
    for (const points of space.floor) line(points, "grid", 1, 1);
    for (const points of space.estimate) line(points, "faint", 1, 0.5, true);
    for (const points of space.truth) line(points, "truth", 4, 0.45);
    for (const points of space.estimate) line(points, "blue", 1.8, 1);
    brush.fillStyle = color("red");
    brush.beginPath();
    brush.arc(...place(...space.estimate[0].slice(0, 3)), 4, 0, 7);
    brush.fill();
    brush.font = "12px system-ui, sans-serif";
    brush.textAlign = "center";
    brush.textBaseline = "middle";
    ["x", "y", "z"].forEach((name, axis) => {
      const end = [...space.corner], tip = [...space.corner];
      end[axis] += space.step;
      tip[axis] += 1.2 * space.step;
      line([...space.corner, ...end], "red", 2, 1);
      brush.fillStyle = color("ink");
      brush.fillText(name, ...place(...tip));
    });
    brush.textAlign = "left";
    brush.fillText(`squares of ${space.step} m`, 4, high - 10);
  }
  function soon() {
    if (!waiting) requestAnimationFrame(draw);
    waiting = true;
  }
  function turn(right, up) {
    azimuth -= right;
    elevation = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, elevation + up));
    soon();
  }
  function enlarge(factor) {
    zoom = Math.max(0.5, Math.min(20, zoom * factor));
    soon();
  }
  function again() {
    [azimuth, elevation] = space.eye;
    zoom = 1;
    soon();
  }
  const apart = () => {
    const [a, b] = [...fingers.values()];
    return Math.hypot(a.x - b.x, a.y - b.y);
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId), now = { x: event.clientX, y: event.clientY };
    if (!before) return;
    const was = fingers.size === 2 ? apart() : 0;
    fingers.set(event.pointerId, now);
    if (fingers.size === 1) turn((now.x - before.x) / 120, (now.y - before.y) / 120);
    else if (was > 0) enlarge(apart() / was);
  });
  for (const name of ["pointerup", "pointercancel"])
    canvas.addEventListener(name, (event) => fingers.delete(event.pointerId));
  canvas.addEventListener("dblclick", again);
  canvas.addEventListener("keydown", (event) => {
    const does = {
      ArrowLeft: () => turn(-0.1, 0), ArrowRight: () => turn(0.1, 0),
      ArrowUp: () => turn(0, -0.1), ArrowDown: () => turn(0, 0.1),
      "+": () => enlarge(1.25), "-": () => enlarge(0.8), 0: again,
    }[event.key];
    if (!does) return;
    event.preventDefault();
    does();
  });
  new ResizeObserver(soon).observe(canvas);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", soon);
  draw();
}
document.querySelectorAll(".space").forEach(show);
