// Plays one cast, or all one after another, seen from above. Shapes are 0.1 s apart; between them each node follows a cubic
// curve, so that the eye sees the whip and not its samples.
(() => {
  const data = JSON.parse(document.getElementById("casts").textContent);
  const box = document.getElementById("player");
  const canvas = box.querySelector("canvas");
  const pen = canvas.getContext("2d");
  const choice = box.querySelector("select");
  const [button, every] = box.querySelectorAll("button");
  const slider = box.querySelector("input[type=range]");
  const slow = box.querySelector("input[type=checkbox]");
  const clock = box.querySelector("output");
  const [[left, near], [right, far]] = data.table_mm;
  // The base is seen, too: the table may begin beyond it.
  const bottom = Math.min(near, -75) - 60, top = far + 60;
  const scale = Math.min(canvas.width / (right - left + 200), canvas.height / (top - bottom));
  const X = (x) => canvas.width / 2 + scale * x;
  const Y = (y) => canvas.height / 2 - scale * (y - (bottom + top) / 2);
  let cast = data.casts[0], time = 0, playing = false, all = false, rest = 0, before = 0;

  data.casts.forEach((one, index) => choice.add(new Option(one.label, index)));
  every.hidden = data.casts.length < 2;

  function halfMetres(low, high) {
    const found = [];
    for (let at = 500 * Math.ceil(low / 500); at < high; at += 500) if (at > low) found.push(at);
    return found;
  }

  function shape(at) {
    const times = cast.times, last = times.length - 1;
    let k = 0;
    while (k < last - 1 && times[k + 1] <= at) k += 1;
    const row = (index) => cast.nodes_mm[Math.max(0, Math.min(last, index))];
    const u = last ? Math.max(0, Math.min(1, (at - times[k]) / (times[k + 1] - times[k]))) : 0;
    const [a, b, c, d] = [row(k - 1), row(k), row(k + 1), row(k + 2)];
    return b.map((value, i) => value + 0.5 * u * (c[i] - a[i] +
      u * (2 * a[i] - 5 * value + 4 * c[i] - d[i] + u * (3 * (value - c[i]) + d[i] - a[i]))));
  }

  function line(points, color, thickness, dash) {
    pen.beginPath();
    for (let i = 0; i < points.length; i += 2) pen.lineTo(X(points[i]), Y(points[i + 1]));
    pen.setLineDash(dash || []);
    pen.strokeStyle = color;
    pen.lineWidth = thickness;
    pen.stroke();
    pen.setLineDash([]);
  }

  function dot(x, y, radius, fill, stroke) {
    pen.beginPath();
    pen.arc(X(x), Y(y), radius, 0, 2 * Math.PI);
    if (fill) { pen.fillStyle = fill; pen.fill(); }
    if (stroke) { pen.strokeStyle = stroke; pen.lineWidth = 2.5; pen.stroke(); }
  }

  function draw() {
    pen.lineCap = pen.lineJoin = "round";
    pen.clearRect(0, 0, canvas.width, canvas.height);
    pen.fillStyle = "#f6f4ef";
    pen.fillRect(X(left), Y(far), scale * (right - left), scale * (far - near));
    for (const x of halfMetres(left, right)) line([x, near, x, far], "#d9dee5", 1.5);
    for (const y of halfMetres(near, far)) line([left, y, right, y], "#d9dee5", 1.5);
    line([left, near, right, near, right, far, left, far, left, near], "#7b8794", 2);
    dot(0, 0, 75 * scale, "#1f2933");
    const trail = [], grip = [];
    for (let t = 0; t <= time; t += 0.02) {
      const past = shape(t);
      grip.push(past[0], past[1]);
      trail.push(past[past.length - 2], past[past.length - 1]);
    }
    const now = shape(time), end = now.length - 2;
    line([0, 0, now[0], now[1]], "#c4ccd6", 16);
    line(grip, "#1f2933", 2.5, [3, 6]);
    line(trail, "#9aa5b1", 2);
    const [tx, ty] = cast.target_mm;
    if (cast.region_mm) line(cast.region_mm, "#cc79a7", 2.5);
    dot(tx, ty, cast.within_mm ? cast.within_mm * scale : 26, null, "#d55e00");
    dot(tx, ty, 5, "#d55e00");
    // Of a rig that does not see the cable's shape, its ends alone are known.
    if (cast.is_seen) line(now, "#0072b2", 7);
    dot(now[0], now[1], 9, "#1f2933");
    dot(now[end], now[end + 1], 10, "#0072b2", "#ffffff");
    clock.textContent = time.toFixed(2) + " s";
    // A cast of one sample has no length.
    slider.value = String(Math.round(1000 * time / (cast.times[cast.times.length - 1] || 1)));
  }

  function tick(stamp) {
    if (!playing) return;
    const end = cast.times[cast.times.length - 1];
    const passed = (stamp - before) / (slow.checked ? 4000 : 1000);
    before = stamp;
    if (time < end) time = Math.min(end, time + passed);
    else if (all && rest < 1.2) rest += passed;
    else if (all && cast !== data.casts[data.casts.length - 1]) choose(data.casts.indexOf(cast) + 1);
    else play(false);
    draw();
    requestAnimationFrame(tick);
  }

  function play(on) {
    playing = on;
    button.textContent = on ? "Pause" : "Play";
    if (on) {
      before = performance.now();
      if (time >= cast.times[cast.times.length - 1]) time = 0;
      requestAnimationFrame(tick);
    }
  }

  function choose(index) {
    cast = data.casts[index];
    choice.value = String(index);
    time = rest = 0;
  }

  button.onclick = () => { all = false; play(!playing); };
  every.onclick = () => { all = true; choose(0); play(true); };
  choice.onchange = () => { all = false; choose(Number(choice.value)); draw(); play(true); };
  slider.oninput = () => {
    play(false);
    time = Number(slider.value) / 1000 * cast.times[cast.times.length - 1];
    draw();
  };
  box.hidden = false;
  time = cast.times[cast.times.length - 1];
  draw();
})();
