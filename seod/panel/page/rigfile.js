// The rig file: read, checked, edited with the schema's help. It applies at the next start.

import { at, make } from "/static/common.js";
import { request } from "/static/wire.js";

export class RigFile {
  constructor(about) {
    this.about = about; this.schema = null; this.loaded = null;
    at("rig-check").onclick = () => this.check();
    at("rig-save").onclick = () => this.save();
    at("rig-save").disabled = !about.command;
    for (const event of ["keyup", "click", "focus"]) at("rig-text").addEventListener(event, () => this.help());
  }

  async show(visible) {
    if (!visible || this.loaded !== null) return;
    const got = await (await fetch("/api/rigfile")).json();
    if (got.error) { at("rig-said").textContent = got.error; return; }
    this.loaded = got.stamp; this.schema = got.schema;
    at("rig-text").value = got.text;
    at("rig-said").textContent = got.path;
  }

  say(text, good) {
    at("rig-said").textContent = text; at("rig-said").className = good ? "ok" : "bad";
  }

  told(errors) {
    at("rig-said").replaceChildren(make("ul", {}, ...errors.map((each) => make("li", {}, each))));
    at("rig-said").className = "bad";
  }

  async check() {
    try {
      const { errors } = await request(this.about, "POST", "/api/rigfile/check", { text: at("rig-text").value });
      if (errors.length) this.told(errors); else this.say("The rig file is right.", true);
    } catch (error) { this.say(error.message, false); }
  }

  async save() {
    try {
      const { errors, stamp } = await request(this.about, "PUT", "/api/rigfile", { text: at("rig-text").value, stamp: this.loaded });
      if (errors.length) { this.told(errors); return; }
      this.loaded = stamp;
      this.say("Saved. It applies at the next start of the daemon.", true);
    } catch (error) { this.say(error.message, false); }
  }

  // What the schema says of the key in whose line the cursor is.
  help() {
    const text = at("rig-text"), lines = text.value.slice(0, text.selectionStart).split("\n");
    const rest = text.value.slice(text.selectionStart).split("\n")[0];
    lines[lines.length - 1] += rest;
    const path = [];
    let depth = Infinity;
    for (let k = lines.length - 1; k >= 0; k--) {
      const found = /^( *)([A-Za-z_][\w-]*):/.exec(lines[k]);
      if (found && found[1].length < depth) { path.unshift(found[2]); depth = found[1].length; }
    }
    at("rig-help").textContent = this.schema && path.length ? `${path.join(".")}: ${describe(this.schema, path)}` : "";
  }
}

function describe(schema, path) {
  let nodes = [schema], told = "";
  for (const key of path) {
    const next = [];
    for (const node of nodes.flatMap((each) => unfold(schema, each))) {
      const found = node.properties?.[key] ?? (typeof node.additionalProperties === "object" ? node.additionalProperties : null)
        ?? Object.values(node.patternProperties || {})[0];
      if (found) next.push(found);
    }
    told = next.map((each) => each.description).find(Boolean) || "";
    nodes = next;
  }
  return told || "no help for this key";
}

function unfold(schema, node, depth = 0) {
  if (!node || depth > 6) return [];
  if (node.$ref) return unfold(schema, schema.$defs[node.$ref.split("/").at(-1)], depth + 1).map((each) => ({ ...each }));
  const parts = [...(node.anyOf || []), ...(node.oneOf || []), ...(node.allOf || [])];
  return [node, ...parts.flatMap((each) => unfold(schema, each, depth + 1))];
}
