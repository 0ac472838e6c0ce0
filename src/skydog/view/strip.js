/* The dogs' altitude, roll and pitch over time: three panels in an SVG, with a cursor.

   An SVG takes its ink from the page, and is drawn once for a mission and a width: from frame to
   frame only the cursor moves. Sizes are in CSS pixels. */
function strip(svg) {
  const LEFT = 40, RIGHT = 20; // room for the numbers of the axes
  const HEAD = 26, TALL = 42, PANEL = HEAD + TALL, BOTTOM = 3 * PANEL, FOOT = 20;
  const LEAST_ALTITUDE = 0.5, LEAST_ANGLE = 5; // m, °: ranges in which a hover looks flat
  const ROUND = [1, 1.5, 2, 3, 4, 5, 6, 8, 10];
  let time, wide, end, cursor;

  const across = (seconds) => LEFT + wide * seconds / end;
  const greatest = (series) => series.reduce((most, all) => Math.max(most, ...all.map(Math.abs)), 0);
  const shown = (number) => String(+number.toFixed(6)).replace("-", "−");

  function roundUp(value) {
    const power = 10 ** Math.floor(Math.log10(value));
    return ROUND.map((n) => n * power).find((n) => n >= value * (1 - 1e-9));
  }

  /** One panel from `low` to `high`; `lines` are [series, class], each series with every dog. */
  function panel(row, title, low, high, lines) {
    const up = (value) => PANEL * (row + 1) - TALL * (value - low) / (high - low);
    const grid = [low, (low + high) / 2, high].map((value) => `
      <path class="grid" d="M${LEFT} ${up(value)}h${wide}"/>
      <text x="${LEFT - 6}" y="${up(value) + 4}" text-anchor="end">${shown(value)}</text>`);
    const paths = lines.flatMap(([series, kind]) => series[0].map((_, k) => {
      const points = series.map((all, i) => `${across(time[i]).toFixed(1)} ${up(all[k]).toFixed(1)}`);
      return `<path class="${kind}" d="M${points.join("L")}"/>`;
    }));
    return `<text x="${LEFT}" y="${up(high) - 8}">${title}</text>${[...grid, ...paths].join("")}`;
  }

  function timeAxis() {
    const rough = 10 ** Math.floor(Math.log10(end / 4));
    const tick = [5, 2, 1].map((n) => n * rough).find((n) => end / n >= 3);
    const lines = [1, 2, 3].map((row) => `M0 ${PANEL * row}v${-TALL}`).join("");
    let axis = "";
    for (let t = 0; t <= end + 1e-6; t += tick) {
      const label = shown(t) + (t + tick > end + 1e-6 ? " s" : "");
      axis += `<path class="grid" d="${lines}" transform="translate(${across(t)} 0)"/>
        <text x="${across(t)}" y="${BOTTOM + 16}" text-anchor="middle">${label}</text>`;
    }
    return axis;
  }

  /** Draw a mission with poses, to the width that the page gives. */
  function draw(mission) {
    const { altitude, setpoint, roll, pitch } = mission.poses;
    time = mission.time;
    end = time.at(-1) || 1; // a mission of one instant has no length
    wide = Math.max(svg.clientWidth - LEFT - RIGHT, 0);
    // A little room above, so that a dog at its highest is not on the frame.
    const top = 1.05 * Math.max(greatest(altitude), greatest(setpoint));
    const highest = roundUp(Math.max(LEAST_ALTITUDE, top));
    // Roll and pitch share their range, so that the two can be compared.
    const steepest = roundUp(Math.max(LEAST_ANGLE, greatest(roll), greatest(pitch)));
    const line = altitude[0].length > 1 ? "thin" : "";
    svg.style.height = `${BOTTOM + FOOT}px`;
    svg.innerHTML = timeAxis()
      + panel(0, "altitude (m), set-point dotted", 0, highest,
        [[altitude, line], [setpoint, "setpoint"]])
      + panel(1, "roll (°)", -steepest, steepest, [[roll, line]])
      + panel(2, "pitch (°)", -steepest, steepest, [[pitch, line]])
      + `<path class="cursor" d="M0 ${HEAD}V${BOTTOM}"/>`;
    cursor = svg.lastElementChild;
  }

  /** Put the cursor at a time in seconds. */
  function move(seconds) {
    cursor.setAttribute("transform", `translate(${across(seconds)} 0)`);
  }

  /** The instant nearest to where a pointer is. */
  function instant(event) {
    const x = event.clientX - svg.getBoundingClientRect().left;
    const far = (i) => Math.abs(across(time[i]) - x);
    return time.reduce((best, _, i) => far(i) < far(best) ? i : best, 0);
  }

  return { draw, move, instant };
}
