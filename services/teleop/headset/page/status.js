// The status of robot and operator in words.

const element = (id) => document.getElementById(id);

function set(id, text, look = "") {
  const node = element(id);
  if (node.textContent !== text) node.textContent = text;
  if (node.classList.contains("pill")) node.className = `pill ${look}`;
}

/** Who has the robot, in words, and how that looks. */
export function whoHasIt({ operator, you }) {
  if (operator.has_robot) return you.drives ? ["you have the robot", "good"] : ["another page has the robot", "warn"];
  if (operator.asks) return ["asking for the robot", "warn"];
  return operator.holder ? [`${operator.holder} has the robot`, "warn"] : ["nobody has the robot", ""];
}

/** What the controller does, and how that looks. */
export function whatItDoes({ robot }) {
  if (!robot.state) return ["no controller", "bad"];
  if (robot.fallen) return ["FALLEN", "bad"];
  if (robot.paused) return ["paused", "warn"];
  if (robot.gait) return [`${robot.gait} ${Math.round(100 * robot.progress)} %`, "good"];
  return [robot.state.toLowerCase().replaceAll("_", " "), robot.guard === "ACTIVE" ? "good" : "warn"];
}

/** The most important thing that the person has to know now. */
export function notice(status) {
  return status.you.notice || status.operator.notice;
}

export function show(status) {
  const { robot, operator, hands, task, refused, you } = status;
  set("state", ...whatItDoes(status));
  set("who", ...whoHasIt(status));
  set("pages", String(operator.pages));
  set("notice", notice(status));
  const alarm = element("alarm");
  alarm.hidden = !status.stop;
  if (status.stop) alarm.textContent = `${status.stop}${status.stop.startsWith("stopped") ? " – press b twice to end the stop" : ""}`;
  const mine = operator.has_robot && you.drives;
  element("take").firstChild.textContent = mine ? "Give it back " : "Take the robot ";
  for (const button of document.querySelectorAll("[data-selects]")) {
    const wanted = button.dataset.selects === "both" ? ["left", "right"] : [button.dataset.selects];
    button.setAttribute("aria-pressed", String(wanted.join() === operator.selected.join()));
  }
  list("gaits", operator.gaits);
  const hand = ({ closure, error }) => `${Math.round(100 * closure)} % closed, off by ${(1000 * error).toFixed(0)} mm`;
  facts([
    ["controller", robot.state ? `${robot.state.toLowerCase().replaceAll("_", " ")}, ${robot.completed} gaits done` : "not heard"],
    ["plant", robot.guard ? `${robot.guard}, pace ${robot.pace.toFixed(2)}` : "not heard"],
    ["left hand", hand(hands.left)],
    ["right hand", hand(hands.right)],
    ["head", `${Math.round((robot.neck * 180) / Math.PI)}° down`],
    ["moved by", operator.headset ? "headset" : "keys and pointer"],
    ...(robot.obstacle ? [["obstacle", robot.obstacle]] : []),
    ...(task ? taskFacts(task) : []),
    ...refusals(refused),
  ]);
}

export function showFigures({ roundTrip, age }) {
  const text = (value) => (Number.isFinite(value) ? `${value.toFixed(0)} ms` : "–");
  element("latency").textContent = text(roundTrip);
  element("age").textContent = text(age);
}

function taskFacts(task) {
  const verdict = task.verdict === "RUNNING" ? `${task.time.toFixed(0)} of ${task.limit.toFixed(0)} s` : `${task.verdict}: ${task.reason}`;
  return [
    ["task", `${task.name}: ${verdict}`],
    ["stages", task.stages.map(([name, done]) => `${done ? "✓" : "·"} ${name}`).join("  ")],
  ];
}

function refusals(refused) {
  const some = Object.entries(refused).filter(([, count]) => count > 0);
  return some.length ? [["refused", some.map(([name, count]) => `${count} ${name}`).join(", ")]] : [];
}

function list(id, lines) {
  const node = element(id);
  if (node.dataset.lines === lines.join("\n")) return;
  node.dataset.lines = lines.join("\n");
  node.replaceChildren(...lines.map((line) => Object.assign(document.createElement("li"), { textContent: line })));
}

function facts(rows) {
  const body = element("facts");
  const text = JSON.stringify(rows);
  if (body.dataset.text === text) return;
  body.dataset.text = text;
  body.replaceChildren(...rows.map(([name, value]) => {
    const row = document.createElement("tr");
    row.append(
      Object.assign(document.createElement("th"), { textContent: name, scope: "row" }),
      Object.assign(document.createElement("td"), { textContent: value }),
    );
    return row;
  }));
}
