  // -- what is told beside the picture

  const metres = (value) => `${value.toFixed(world.size < 30 ? 2 : 1)} m`;

  function tell() {
    if (!flights.length || !views.length) return;
    const [own, other] = flights, count = own.drives.length, driving = own.drives.filter(Boolean).length;
    const doing = own.done ? ["accomplished", "goal"]
      : driving === count ? ["driving", "drive"] : driving === 0 ? ["collecting", "collect"]
      : [`${driving} driving, ${count - driving} collecting`, "collect"];
    find(".doing").textContent = doing[0];
    find(".doing").style.background = `var(--${doing[1]})`;
    const time = (flight) => `${(flight.step * world.dt).toFixed(world.dt < 1 ? 1 : 0)} s`;
    const home = (flight) => `${flight.home} of ${flight.sheep.length}`;
    find(".alone").hidden = Boolean(other); find(".score").hidden = !other;
    find(".step").textContent = own.step;
    find(".time").textContent = time(own);
    find(".flown").textContent = metres(own.flown);
    find(".home").textContent = home(own);
    if (other) {
      find(".rival").textContent = settings.policy; find(".rival").title = settings.policy;
      const cells = [...document.querySelectorAll(".score tbody td")];
      [own.step, other.step, metres(own.flown), metres(other.flown), home(own), home(other)]
        .forEach((text, k) => { cells[k].textContent = text; });
    }
    find(".away").textContent = metres(own.away);
    find(".spread").textContent = metres(own.spread);
    spark(".aways", 1, "--goal", world.radius, "goal");
    spark(".spreads", 2, "--sheep", world.gathered, "f(N)");
    if (!trouble) news(outcome(own, other), false);
  }

  function outcome(own, other) {
    if (!other) return own.done ? `home in ${own.step} steps, ${metres(own.flown)} flown` : "";
    const rival = settings.policy;
    if (waits) return "ready? the race starts when you move";
    if (own.done && other.done) return own.step < other.step
      ? `you won: ${own.step} steps, ${rival} took ${other.step}`
      : own.step > other.step ? `${rival} won: ${other.step} steps, you took ${own.step}`
      : `a draw: ${own.step} steps each`;
    if (own.done) return `you won, in ${own.step} steps`;
    return other.done ? `${rival} is home, in ${other.step} steps; can you still bring yours?` : "";
  }

  function news(text, bad) {
    const said = find(".news");
    if (said.textContent !== text) said.textContent = text;
    said.classList.toggle("trouble", bad);
  }

  const HINTS = {
    watch: "Drag the dog, a sheep or the goal.",
    fly: "You are the dog: arrow keys or WASD, or hold the pointer where it should fly.",
    race: "You against the sheepdog, on the same case: arrow keys or WASD, or hold the pointer.",
  };

  function reflect() {
    const put = (selector, value) => {
      const box = find(selector), out = box.parentElement.querySelector("output");
      if (document.activeElement !== box || box.type !== "number") box.value = value;
      if (out) out.textContent = UNITS[box.className](+box.value);
    };
    put(".policy", settings.policy); put(".preset", settings.preset);
    put(".scene", settings.scene ?? OPEN);
    put(".size", world.size); put(".sheep", settings.sheep); put(".dogs", settings.dogs);
    put(".speed", nearest(settings.speed));
    for (const noise of ["noise", "perception", "actuation"]) put(`.${noise}`, settings[noise]);
    find(`[name=mode][value=${settings.mode}]`).checked = true;
    find(".preset").closest("fieldset").querySelector(".about").textContent = hello.presets[settings.preset].replace(/\.$/, "");
    find(".hint").textContent = HINTS[settings.mode];
    find(".play path").setAttribute("d", settings.paused ? PLAY : PAUSE);
    find(".play span").textContent = settings.paused ? "Play" : "Pause";
    canvas.style.cursor = settings.mode === "watch" ? "default" : "crosshair";
  }

  const nearest = (speed) => hello.speeds.reduce(
    (best, s, k) => Math.abs(s - speed) < Math.abs(hello.speeds[best] - speed) ? k : best, 0);
  const UNITS = {
    speed: (k) => `${hello.speeds[k]}×`, sheep: String, dogs: String,
    noise: (e) => e.toFixed(2), perception: (x) => `±${x.toFixed(2)} m`, actuation: (v) => `±${v.toFixed(2)} m/s`,
  };

  // -- the hand

  function spot(thing, shown, goal) {
    return thing.who === "goal" ? goal : shown[thing.list][thing.number];
  }

  // Whom a pointer would take hold of: the goal's handle, a dog or a sheep, whichever is nearest.
  function near(x, y) {
    if (!views.length) return null;
    const shown = glided(views[0], performance.now()), things = [{ who: "goal", list: null, number: 0 }];
    if (settings.mode === "watch") {
      shown.dogs.forEach((_, number) => things.push({ who: "dog", list: "dogs", number }));
      shown.sheep.forEach((_, number) => things.push({ who: "sheep", list: "sheep", number }));
    }
    let best = null, least = REACH;
    for (const thing of things) {
      const [px, py] = picture.at(spot(thing, shown, world.goal));
      // A dog among sheep is the one meant.
      const away = Math.hypot(px - x, py - y) * (thing.who === "sheep" ? 1.6 : 1);
      if (away < least) { best = thing; least = away; }
    }
    return best;
  }

  const pointed = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left - canvas.clientLeft, event.clientY - box.top - canvas.clientTop];
  };
  const clamp = (p, beyond) => p.map((x, axis) => Math.min(Math.max(x, -beyond), [world.size, world.height][axis] + beyond));

  function point(event) {
    const place = picture.place(pointed(event));
    if (held) {
      held.at = clamp(place, held.who === "dog" ? world.airspace : 0);
      outbox.hold = { who: held.who, number: held.number, at: held.at };
    } else {
      aim = clamp(place, world.airspace);
      outbox.fly = { toward: aim };
    }
    wake();
  }

  // Moves of the pointer go out once a frame.
  function flush() {
    if (Object.keys(outbox).length) { say(outbox); outbox = {}; }
  }

  canvas.onpointerdown = (event) => {
    if (!world || event.button) return;
    canvas.focus({ preventScroll: true });
    held = near(...pointed(event));
    if (!held && settings.mode === "watch") return;
    canvas.setPointerCapture(event.pointerId);
    canvas.style.cursor = held ? "grabbing" : "crosshair";
    event.preventDefault();
    point(event);
  };
  canvas.onpointermove = (event) => {
    if (held || aim) return point(event);
    if (!world || event.pointerType === "touch") return;
    hovered = near(...pointed(event));
    canvas.style.cursor = hovered ? "grab" : settings.mode === "watch" ? "default" : "crosshair";
    wake();
  };
  const release = () => {
    if (held) outbox.hold ? (flush(), say({ hold: null })) : say({ hold: null });
    if (held?.who === "goal") world = { ...world, goal: held.at };
    if (aim) { flush(); say({ fly: null }); }
    held = aim = null;
    canvas.style.cursor = settings?.mode === "watch" ? "default" : "crosshair";
    wake();
  };
  canvas.onpointerup = canvas.onpointercancel = canvas.onlostpointercapture = () => {
    if (held || aim) release();
  };
  canvas.onpointerleave = () => { hovered = null; wake(); };

  const WAYS = {
    ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1],
    KeyA: [-1, 0], KeyD: [1, 0], KeyW: [0, 1], KeyS: [0, -1],
  };

  function steer() {
    const along = [0, 1].map((axis) => Math.sign([...keys].reduce((sum, k) => sum + WAYS[k][axis], 0)));
    say({ fly: keys.size ? { along } : null });
  }

  onkeydown = (event) => {
    if (!settings || event.altKey || event.ctrlKey || event.metaKey) return;
    const box = event.target.closest("input, select");
    if (box?.type === "number" || (box?.matches("select") && !event.key.startsWith("Arrow"))) return;
    const arrow = event.code in WAYS, own = box && event.key.startsWith("Arrow");
    if (arrow && event.shiftKey && !own) {
      const [x, y] = WAYS[event.code], far = world.size / 40;
      world = { ...world, goal: clamp([world.goal[0] + far * x, world.goal[1] + far * y], 0) };
      say({ hold: { who: "goal", number: 0, at: world.goal } });
    } else if (arrow && settings.mode !== "watch" && !own) {
      if (!event.repeat) { keys.add(event.code); steer(); }
    } else if (event.key === " " && !event.target.closest("button, [type=radio]")) toggle();
    else if (event.key === ".") say({ step: true });
    else if (event.code === "KeyR") say({ reset: true });
    else if (event.code === "KeyN") another();
    else if ("123".includes(event.key)) say({ mode: ["watch", "fly", "race"][event.key - 1] });
    else return;
    event.preventDefault();
  };
  onkeyup = (event) => { if (keys.delete(event.code)) steer(); };
  onblur = () => { if (keys.size) { keys.clear(); steer(); } };

  // -- the choices

  const toggle = () => say({ paused: !settings.paused });
  const another = () => say({ case: (settings.case + 1) % 2 ** 31 });

  find(".play").onclick = toggle;
  find(".single").onclick = () => say({ step: true });
  find(".again").onclick = () => say({ reset: true });
  find(".other").onclick = another;
  // Who clicks goes on with the keys of the arena.
  find(".transport").onclick = (event) => {
    if (event.detail && event.target.closest("button")) canvas.focus({ preventScroll: true });
  };
  find(".policy").onchange = (event) => say({ policy: event.target.value });
  find(".preset").onchange = (event) => say({ preset: event.target.value });
  find(".scene").onchange = (event) => say({ scene: event.target.value === OPEN ? null : event.target.value });
  find(".size").onchange = (event) => say({ arena: event.target.valueAsNumber });
  for (const radio of document.querySelectorAll("[name=mode]")) radio.onchange = () => {
    say({ mode: radio.value });
    canvas.focus({ preventScroll: true });
  };
  for (const box of document.querySelectorAll("input[type=range]")) {
    const named = box.className, told = box.parentElement.querySelector("output");
    const message = () => ({ [named]: named === "speed" ? hello.speeds[box.value] : +box.value });
    // Another number of sheep or dogs is compiled anew: when the slider rests.
    const whole = named === "sheep" || named === "dogs";
    box.oninput = () => { told.textContent = UNITS[named](+box.value); if (!whole) say(message()); };
    if (whole) box.onchange = () => say(message());
  }
  find("form").onsubmit = (event) => event.preventDefault();
  new ResizeObserver(() => { tell(); wake(); }).observe(canvas);
  dark.addEventListener("change", () => { tell(); wake(); });

  // For the curious, and for tests.
  window.skydog = {
    get settings() { return settings; },
    get world() { return world; },
    get flights() { return flights; },
    get start() { return start; },
    get hand() { return { held, hovered }; },
    screen(place) {
      const box = canvas.getBoundingClientRect(), [x, y] = picture.at(place);
      return [box.left + canvas.clientLeft + x, box.top + canvas.clientTop + y];
    },
  };
  connect();
