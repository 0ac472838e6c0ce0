  const find = (selector) => document.querySelector(selector);
  const canvas = find("canvas.arena"), picture = arena(canvas, document.body);
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  const KEEP = 240; // points of a trail
  const REACH = 26; // pixels within which a pointer takes hold
  const OPEN = "none"; // of the scenes
  const PLAY = "M4 2v12l10-6z", PAUSE = "M3 2h4v12H3zM9 2h4v12H9z";

  let socket, hello, settings, world, start = 0, frames = 0;
  let flights = [];  // as the server last told
  let views = [];    // as they are shown: positions on their way, trails, history
  let camera, held = null, hovered = null, aim = null, outbox = {}, seen = 0;
  let waits = false, scheduled = false, before = 0, ripple = 0, trouble = 0;
  const keys = new Set();

  // -- the server

  function connect() {
    // Beside this page, wherever a proxy has put it; https asks for wss.
    const address = new URL("live", location);
    address.protocol = address.protocol.replace("http", "ws");
    socket = new WebSocket(address);
    socket.onmessage = ({ data }) => hear(JSON.parse(data));
    socket.onclose = () => {
      linked(false);
      setTimeout(connect, 1000);
    };
  }

  function linked(yes) {
    find(".link").classList.toggle("lost", !yes);
    find(".link").textContent = yes ? "live" : "no connection, trying again";
    find(".busy").hidden = true;
  }

  function say(message) {
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
  }

  function hear(message) {
    if (message.error) {
      trouble = performance.now() + 5000;
      news(message.error, true);
      if (settings) reflect();
      wake();
    } else if (message.hello) {
      hello = message.hello;
      welcome();
    } else if (message.compiling) {
      find(".busy").hidden = false;
    } else {
      find(".busy").hidden = true;
      frames = message.frame;
      receive(message);
    }
  }

  function welcome() {
    linked(true);
    frames = seen = 0; start = 0;
    const fill = (select, names) => select.replaceChildren(...names.map((n) => new Option(n, n)));
    fill(find(".policy"), hello.policies);
    fill(find(".preset"), Object.keys(hello.presets));
    fill(find(".scene"), [OPEN, ...hello.scenes]);
    find(".sheep").max = hello.sheep; find(".dogs").max = hello.dogs;
    find(".speed").max = hello.speeds.length - 1;
    if (settings) { // the server was away: go on where this page was
      const { preset, arena: size, ...rest } = settings;
      say({ preset });
      say(size === null ? rest : { ...rest, arena: size });
    } else if (still.matches) say({ paused: true });
  }

  function receive(message) {
    const fresh = message.start !== undefined && message.start !== start;
    if (message.world) world = message.world;
    if (message.settings) { settings = message.settings; reflect(); }
    if (fresh) { start = message.start; views = []; held = null; camera = undefined; ripple = 0; }
    if (message.beyond) {
      const asked = message.beyond.join("; ");
      find(".beyond").textContent = asked && `It was taught ${asked}.`;
    }
    if (message.waits !== undefined) waits = message.waits;
    if (message.flights) {
      const now = performance.now();
      message.flights.forEach((flight, k) => arrive(flight, k, now));
      flights = message.flights;
      views.length = flights.length;
    }
    tell();
    wake();
  }

  // A view glides from where it is shown to where the server says, in the time that took there.
  function arrive(flight, k, now) {
    const view = views[k] ??= {
      sheep: flight.sheep, dogs: flight.dogs, subgoal: flight.subgoal, at: 0, span: 0, step: -1,
      trails: { sheep: flight.sheep.map(() => []), dogs: flight.dogs.map(() => []) }, history: [],
    };
    const steps = flight.step - view.step, pace = 1000 * world.dt / settings.speed;
    if (view.step >= 0) view.from = glided(view, now);
    else view.from = flight;
    view.to = flight; view.at = now;
    view.span = view.step < 0 || steps <= 0 ? 0 : Math.min(settings.paused ? 150 : steps * pace, 1000);
    if (flight.done && !flights[k]?.done && view.step >= 0 && k === 0) ripple = now;
    if (!flight.done) ripple = k === 0 ? 0 : ripple;
    if (flight.step !== view.step) {
      view.history.push([flight.step, flight.away, flight.spread]);
      if (view.history.length > 500) view.history = view.history.filter((_, n) => n % 2 === 0);
    }
    view.step = flight.step;
  }

  const between = (a, b, part) => a.length !== b.length ? b : a.map((p, k) => [
    p[0] + part * (b[k][0] - p[0]), p[1] + part * (b[k][1] - p[1]),
  ]);

  function glided(view, now) {
    const part = view.span && !still.matches ? Math.min((now - view.at) / view.span, 1) : 1;
    const jump = (a, b) => part < 1 && Math.hypot(a[0] - b[0], a[1] - b[1]) > world.size / 6;
    const subgoal = between(view.from.subgoal, view.to.subgoal, part)
      .map((p, k) => jump(view.from.subgoal[k] ?? p, view.to.subgoal[k]) ? view.to.subgoal[k] : p);
    return {
      sheep: between(view.from.sheep, view.to.sheep, part),
      dogs: between(view.from.dogs, view.to.dogs, part),
      subgoal, drives: view.to.drives, part,
    };
  }

  // -- the picture

  function wake() {
    if (!scheduled) { scheduled = true; requestAnimationFrame(tick); }
  }

  function tick(now) {
    scheduled = false;
    flush();
    if (frames > seen) { seen = frames; say({ seen }); }
    if (!world || !views.length) return;
    const moving = draw(now, Math.min(now - before, 100));
    before = now;
    if (trouble && now > trouble) { trouble = 0; tell(); }
    if (moving || trouble || held || aim) wake();
  }

  function draw(now, elapsed) {
    const shown = views.map((view) => glided(view, now));
    if (held && held.who !== "goal" && shown[0][held.list][held.number]) {
      shown[0][held.list] = shown[0][held.list].slice();
      shown[0][held.list][held.number] = held.at;
    }
    const place = held?.who === "goal" ? held.at : world.goal;
    const panning = pan(shown, elapsed);
    shown.forEach((view, k) => leave(views[k].trails, view));
    picture.begin({ ...world, goal: place }, camera[0].now, camera[1].now);
    picture.sensing(shown[0].dogs);
    picture.ground(false);
    if (shown[1]) picture.faintly(0.38, () => one(shown[1], views[1]));
    one(shown[0], views[0]);
    if (shown[1]) name(shown[1].dogs[0], settings.policy, 0.55);
    if (settings.mode !== "watch") {
      if (shown[1]) name(shown[0].dogs[0], "you", 0.9);
      picture.disc(shown[0].dogs[0], 16); picture.stroke("dog", 1.5, 0.7);
    }
    handle(place);
    if (hovered && !held) {
      picture.disc(spot(hovered, shown[0], place), hovered.who === "sheep" ? 11 : 17);
      picture.stroke("ink", 1.5, 0.55);
    }
    if (aim) {
      picture.line([shown[0].dogs[0], aim]); picture.stroke("dog", 1.2, 0.6, [2, 5]);
      picture.disc(aim, 6); picture.stroke("dog", 2, 0.9);
    }
    const age = ripple && !still.matches ? (now - ripple) / 1400 : 1;
    if (age < 1) for (const late of [0, 0.25]) {
      const part = Math.max(age - late, 0) / (1 - late);
      picture.disc(place, world.radius * (0.4 + 0.8 * part) * picture.scale());
      picture.stroke("goal", 4 * (1 - part) + 0.5, 0.8 * (1 - part));
    }
    return panning || age < 1 || shown.some((view) => view.part < 1);
  }

  function one(shown, view) {
    const until = (paths, now) => paths.map((path, k) => [...path, now[k]]);
    picture.trails(until(view.trails.sheep, shown.sheep), "sheep", 1.25, (dark.matches ? 0.85 : 0.55) - Math.min(0.2, shown.sheep.length / 300));
    picture.trails(until(view.trails.dogs, shown.dogs), "dog", 1.75, dark.matches ? 0.85 : 0.6);
    picture.flock(shown);
  }

  // What a trail keeps: points far enough apart to be told, the latest of them.
  function leave(trails, shown) {
    for (const list of ["sheep", "dogs"]) shown[list].forEach((p, k) => {
      const path = trails[list][k], last = path.at(-1);
      if (held && held.list === list && held.number === k) { if (last) path.push(null); return; }
      if (last && Math.hypot(p[0] - last[0], p[1] - last[1]) < world.size / 160) return;
      path.push(p);
      if (path.length > KEEP * (list === "dogs" ? 4 : 1)) path.shift();
    });
  }

  // The picture holds the arena and whoever flies beyond it, and widens slowly.
  function pan(shown, elapsed) {
    const size = Math.max(world.size, world.height), margin = 0.06 * size;
    const fit = (side) => [-margin, side + margin];
    const outside = shown.flatMap(({ dogs, subgoal }) => [...dogs, ...subgoal]);
    camera ??= [world.size, world.height].map((side) => ({ now: fit(side), then: fit(side) }));
    if (held || aim) return false; // nothing slips away under the hand
    const part = still.matches ? 1 : 1 - Math.exp(-elapsed / 180);
    let off = 0;
    camera.forEach(({ now, then }, axis) => {
      for (const p of outside) {
        then[0] = Math.min(then[0], p[axis] - margin); then[1] = Math.max(then[1], p[axis] + margin);
      }
      for (const end of [0, 1]) {
        now[end] += part * (then[end] - now[end]); off += Math.abs(then[end] - now[end]);
      }
    });
    return off > 1e-3 * size;
  }

  function handle(place) {
    picture.disc(place, 8); picture.fill("goal"); picture.stroke("ink", 1.2, 0.6);
    picture.disc(place, 3); picture.fill("ink", 0.75);
  }

  function name(place, text, alpha) {
    const [x, y] = picture.at(place), { pen } = picture;
    pen.font = "600 12px system-ui, sans-serif"; pen.textAlign = "center"; pen.textBaseline = "bottom";
    pen.fillStyle = getComputedStyle(document.body).color; pen.globalAlpha = alpha;
    pen.fillText(text.length > 24 ? `…${text.slice(-23)}` : text, x, y - 19); pen.globalAlpha = 1;
  }

  function spark(selector, column, role, threshold, called) {
    const chart = find(selector), ratio = devicePixelRatio || 1, pen = chart.getContext("2d");
    const wide = chart.clientWidth, tall = chart.clientHeight, style = getComputedStyle(document.body);
    const columns = Math.round(wide * ratio), rows = Math.round(tall * ratio);
    if (chart.width !== columns || chart.height !== rows) { chart.width = columns; chart.height = rows; }
    pen.setTransform(ratio, 0, 0, ratio, 0, 0); pen.clearRect(0, 0, wide, tall);
    const series = views.map((view) => view.history);
    const far = Math.max(20, ...series.map((row) => row.at(-1)?.[0] ?? 0));
    const most = 1.4 * Math.max(threshold, 1e-6, ...series.flatMap((row) => row.map((r) => r[column])));
    const at = (step, value) => [2 + (wide - 6) * step / far, tall - 3 - (tall - 6) * value / most];
    pen.lineWidth = 1; pen.strokeStyle = style.color; pen.globalAlpha = 0.45; pen.setLineDash([4, 3]);
    pen.beginPath(); pen.moveTo(...at(0, threshold)); pen.lineTo(...at(far, threshold)); pen.stroke();
    pen.setLineDash([]);
    pen.globalAlpha = 0.25;
    pen.beginPath(); pen.moveTo(0, tall - 0.5); pen.lineTo(wide, tall - 0.5); pen.stroke();
    pen.strokeStyle = pen.fillStyle = style.getPropertyValue(role); pen.lineJoin = "round";
    [...series.keys()].reverse().forEach((k) => {
      if (!series[k].length) return;
      pen.globalAlpha = k ? 0.4 : 1; pen.lineWidth = k ? 1.2 : 1.8; pen.beginPath();
      series[k].forEach((row) => pen.lineTo(...at(row[0], row[column])));
      pen.stroke();
      pen.beginPath(); pen.arc(...at(series[k].at(-1)[0], series[k].at(-1)[column]), 2.5, 0, 7); pen.fill();
    });
    // On the side of its line where the curve does not begin, if there is room.
    const line = at(0, threshold)[1], begins = series[0][0]?.[column] ?? 0;
    const below = line < 14 || (begins > threshold && line + 16 < tall);
    pen.font = "11px system-ui, sans-serif"; pen.fillStyle = style.color; pen.globalAlpha = 0.7;
    pen.textAlign = "left"; pen.textBaseline = below ? "top" : "bottom";
    pen.fillText(`${called} ${metres(threshold)}`, 2, line + (below ? 4 : -2));
    pen.globalAlpha = 1;
  }
