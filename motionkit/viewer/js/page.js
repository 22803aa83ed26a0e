// The player on a page of its own: a stand-in for the notebook's model, and the page's data.

class PageModel {
  constructor(values) { this.values = values; this.heard = {}; }
  get(name) { return this.values[name]; }
  set(name, value) {
    if (this.values[name] === value) return;
    this.values[name] = value;
    (this.heard[`change:${name}`] || []).forEach((act) => act());
  }
  on(name, act) { (this.heard[name] ||= []).push(act); }
  off(name, act) { this.heard[name] = (this.heard[name] || []).filter((a) => a !== act); }
  save_changes() {}
}

const values = JSON.parse(document.getElementById("motionkit-values").textContent);
const text = atob(document.getElementById("motionkit-data").textContent.trim());
values._data = new DataView(Uint8Array.from(text, (c) => c.charCodeAt(0)).buffer);
const root = document.getElementById("motionkit-player");
const fit = () => Math.max(240, window.innerHeight - 110);
if (values.fill) values.height = fit();
const model = new PageModel(values);
root.motionkit = new Player(root, model);
if (values.fill) window.addEventListener("resize", () => model.set("height", fit()));
