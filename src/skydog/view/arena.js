/* How a flock is drawn, seen from above: shared by the replay and the live view.

   `begin` fits the picture to a world and to the metres to be seen across and up, and clears it;
   what is drawn afterwards is in metres, y up.
   Sizes of marks are in CSS pixels, and the colours are the roles of the element `root`. */
function arena(canvas, root) {
  const pen = canvas.getContext("2d");
  const INSET = 14, DIGIT = 8; // around the picture, for the axes' numbers of three digits; one more
  const ROLES = ["sheep", "dog", "goal", "subgoal", "collect", "drive", "arena"];
  let world, colours, zoom, left, bottom, strength = 1;

  function begin(shown, across, up = across) {
    const ratio = window.devicePixelRatio || 1, style = getComputedStyle(root);
    const wide = canvas.clientWidth, tall = canvas.clientHeight;
    const columns = Math.round(wide * ratio), rows = Math.round(tall * ratio);
    if (canvas.width !== columns || canvas.height !== rows) {
      canvas.width = columns; canvas.height = rows;
    }
    world = shown;
    colours = { ink: style.color };
    for (const role of ROLES) colours[role] = style.getPropertyValue("--" + role);
    const inset = INSET + DIGIT * Math.max(world.size.toFixed().length - 3, 0);
    const room = (pixels, [low, high]) => Math.max(pixels - 2 * inset, 0) / (high - low);
    zoom = Math.min(room(wide, across), room(tall, up));
    left = (wide - zoom * (across[0] + across[1])) / 2; // where x is 0, and y
    bottom = (tall + zoom * (up[0] + up[1])) / 2;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, wide, tall);
    pen.lineJoin = pen.lineCap = "round";
    strength = 1;
  }

  const at = ([x, y]) => [left + x * zoom, bottom - y * zoom];
  const place = ([x, y]) => [(x - left) / zoom, (bottom - y) / zoom];

  function stroke(role, width, alpha = 1, dash = []) {
    pen.strokeStyle = colours[role]; pen.lineWidth = width; pen.globalAlpha = alpha * strength;
    pen.setLineDash(dash); pen.stroke(); pen.setLineDash([]); pen.globalAlpha = 1;
  }
  function fill(role, alpha = 1) {
    pen.fillStyle = colours[role]; pen.globalAlpha = alpha * strength; pen.fill(); pen.globalAlpha = 1;
  }
  function disc(centre, pixels) {
    pen.beginPath(); pen.arc(...at(centre), pixels, 0, 2 * Math.PI);
  }
  function line(points) {
    pen.beginPath(); points.forEach((p) => pen.lineTo(...at(p)));
  }
  function cross(centre, arm, turned) {
    const [x, y] = at(centre), [a, b] = turned ? [arm, 0] : [arm, arm];
    pen.beginPath();
    pen.moveTo(x - a, y - b); pen.lineTo(x + a, y + b);
    pen.moveTo(x - b, y + a); pen.lineTo(x + b, y - a);
  }
  /** Draw more faintly what `drawing` draws. */
  function faintly(share, drawing) {
    strength = share; drawing(); strength = 1;
  }

  /** Walls, grid with metres (from `zero` or the first line), and the goal within the walls. */
  function ground(zero = true) {
    const { size, height = size, obstacles = [], goal, radius } = world;
    const walls = [...at([0, height]), size * zoom, height * zoom];
    pen.save();
    pen.beginPath(); pen.rect(...walls); pen.clip();
    disc(goal, radius * zoom);
    fill("goal", 0.14); stroke("goal", 1.5, 0.8);
    pen.restore();
    const rough = 10 ** Math.floor(Math.log10(size / 4));
    const tick = [5, 2, 1].map((n) => n * rough).find((n) => size / n >= 3);
    pen.font = "12px system-ui, sans-serif"; pen.fillStyle = colours.ink;
    for (let x = 0; x <= Math.max(size, height) + 1e-6; x += tick) {
      const label = +x.toFixed(6) + (x + tick > size ? " m" : "");
      const across = x <= size + 1e-6, up = x <= height + 1e-6;
      if (across) { line([[x, 0], [x, height]]); stroke("ink", 1, 0.07); }
      if (up) { line([[0, x], [size, x]]); stroke("ink", 1, 0.07); }
      pen.globalAlpha = 0.6;
      pen.textAlign = "center"; pen.textBaseline = "top";
      if (across && (x > 0 || zero)) pen.fillText(label, at([x, 0])[0], at([x, 0])[1] + 5);
      pen.textAlign = "right"; pen.textBaseline = "middle";
      if (up && x > 0) pen.fillText(+x.toFixed(6), at([0, x])[0] - 5, at([0, x])[1]);
      pen.globalAlpha = 1;
    }
    for (const [x, y, a, b, r] of obstacles) { // a line so thick, with round ends, is a capsule
      line([[x, y], [a, b]]); stroke("arena", Math.max(2 * r * zoom, 1));
    }
    pen.beginPath(); pen.rect(...walls); stroke("arena", 1.5);
  }

  /** Where sheep see a dog: R_πβ about each, fainter the more there are. */
  function sensing(dogs) {
    if (!world.sensing) return; // a law of one's own may have no such range
    const alpha = 0.08 / Math.sqrt(dogs.length);
    dogs.forEach((p) => { disc(p, world.sensing * zoom); fill("dog", alpha); });
  }

  /** Paths in one stroke, so that where they cross is no darker; null in a path is a gap. */
  function trails(paths, role, width, alpha) {
    pen.beginPath();
    for (const path of paths) {
      let drawn = false;
      for (const p of path) {
        if (p === null) { drawn = false; continue; }
        const [x, y] = at(p);
        if (drawn) pen.lineTo(x, y); else pen.moveTo(x, y);
        drawn = true;
      }
    }
    stroke(role, width, alpha);
  }

  /** Each dog's way to its subgoal, in the colour of what it does. */
  function ways(dogs, subgoal, drives) {
    dogs.forEach((p, k) => { line([p, subgoal[k]]); stroke(drives[k] ? "drive" : "collect", 2.5); });
  }

  function drone(centre) {
    const [x, y] = at(centre);
    cross(centre, 6); stroke("dog", 2.5);
    for (const [dx, dy] of [[-6, -6], [6, -6], [-6, 6], [6, 6]]) {
      pen.beginPath(); pen.arc(x + dx, y + dy, 4, 0, 2 * Math.PI);
      fill("dog", 0.2); stroke("dog", 2);
    }
  }

  /** Ticks from under the sheep's discs: which way each of them faces, as [x, y] of any length. */
  function headings(sheep, facing, size) {
    pen.beginPath();
    facing.forEach(([dx, dy], k) => {
      const [x, y] = at(sheep[k]), long = 1.6 * size + 2, whole = Math.hypot(dx, dy) || 1;
      pen.moveTo(x, y); pen.lineTo(x + long * dx / whole, y - long * dy / whole);
    });
    stroke("ink", 2, 0.8);
  }

  /** Everybody now, and the flock's centre with f(N) about it; sheep with no heading lack `facing`. */
  function flock({ sheep, dogs, subgoal, drives, facing = [] }) {
    const centre = [0, 1].map((axis) => sheep.reduce((sum, p) => sum + p[axis], 0) / sheep.length);
    const size = Math.max(3, Math.min(6, 36 / Math.sqrt(sheep.length)));
    disc(centre, world.gathered * zoom); stroke("ink", 1.2, 0.6, [5, 4]);
    cross(centre, 4, true); stroke("ink", 1.2, 0.7);
    ways(dogs, subgoal, drives);
    headings(sheep, facing, size);
    sheep.forEach((p) => { disc(p, size); fill("sheep"); stroke("ink", 1, 0.5); });
    dogs.forEach(drone);
    subgoal.forEach((p) => { cross(p, 5); stroke("subgoal", 3); });
  }

  return {
    pen, begin, at, place, stroke, fill, disc, line, cross, faintly, ground, sensing, trails, flock,
    scale: () => zoom,
  };
}
