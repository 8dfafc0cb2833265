// A drive in JavaScript: the WebAssembly module beside this file, which imports nothing.
//
//     import { loadModule } from "./drive.mjs";
//     const module = await loadModule(bytesOfDriveWasm);   // an ArrayBuffer or Uint8Array
//     const drive = module.open();
//     drive.doStep(0.01);
//     drive.get("T_d");
//
// Units are SI; microvib.h says what each function does.

const text = new TextDecoder();
const encoder = new TextEncoder();

export async function loadModule(bytes) {
  const { instance } = await WebAssembly.instantiate(bytes, {});
  instance.exports._initialize();
  return new DriveModule(instance.exports);
}

class DriveModule {
  constructor(code) {
    this.code = code;
  }

  open() {
    return new Drive(this.code);
  }
}

class Drive {
  constructor(code) {
    this.code = code;
    const why = code.malloc(256);
    this.at = code.microvib_new(why, 256);
    const said = this.#read(why);
    code.free(why);
    if (!this.at) throw new Error(said);
  }

  get time() {
    return this.code.microvib_time(this.at);
  }

  get outputs() {
    const count = this.code.microvib_outputs(this.at);
    return Array.from({ length: count }, (_, k) => ({
      name: this.#read(this.code.microvib_output_name(this.at, k)),
      unit: this.#read(this.code.microvib_output_unit(this.at, k)),
      meaning: this.#read(this.code.microvib_output_meaning(this.at, k)),
    }));
  }

  get channels() {
    const count = this.code.microvib_columns(this.at);
    return Array.from({ length: count }, (_, k) => this.#read(this.code.microvib_channel_name(this.at, k)));
  }

  get parameters() {
    const count = this.code.microvib_parameters(this.at);
    return Array.from({ length: count }, (_, k) => ({
      name: this.#read(this.code.microvib_parameter_name(this.at, k)),
      value: this.code.microvib_parameter(this.at, k),
    }));
  }

  doStep(stop) {
    this.#ask(this.code.microvib_do_step(this.at, stop));
  }

  get(name) {
    const which = this.#number(name);
    if (which < 0) throw new Error(`there is no output ${name}`);
    return this.code.microvib_output(this.at, which);
  }

  setParameter(name, value) {
    const which = this.parameters.findIndex((parameter) => parameter.name === name);
    if (which < 0) throw new Error(`there is no parameter ${name}`);
    this.#ask(this.code.microvib_set_parameter(this.at, which, value));
  }

  // Before the first step: internal steps that do not end where communication steps do.
  setIndependent(on) {
    this.#ask(this.code.microvib_set_independent(this.at, on ? 1 : 0));
  }

  setRate(rate) {
    this.#ask(this.code.microvib_set_rate(this.at, rate));
  }

  setMicrosteps(count) {
    this.#ask(this.code.microvib_set_microsteps(this.at, BigInt(count)));
  }

  setHubAcceleration(acceleration) {
    this.#ask(this.code.microvib_set_hub_acceleration(this.at, acceleration));
  }

  setShaftTorque(torque) {
    this.#ask(this.code.microvib_set_shaft_torque(this.at, torque));
  }

  beginRecord(first, width) {
    this.#ask(this.code.microvib_begin_record(this.at, first, width));
  }

  // Rows of a record, one after the other, as a Float64Array.
  record(count) {
    const size = count * this.code.microvib_columns(this.at);
    const rows = this.code.malloc(8 * size);
    if (!rows) throw new Error("there is no memory for the record");
    const failed = this.code.microvib_record(this.at, count, rows);
    const found = new Float64Array(this.code.memory.buffer, rows, size).slice();
    this.code.free(rows);
    this.#ask(failed);
    return found;
  }

  get state() {
    const bytes = this.code.microvib_state_bytes(this.at);
    const room = this.code.malloc(bytes);
    this.code.microvib_get_state(this.at, room);
    const found = new Uint8Array(this.code.memory.buffer, room, bytes).slice();
    this.code.free(room);
    return found;
  }

  set state(content) {
    if (content.length !== this.code.microvib_state_bytes(this.at)) throw new Error("the state is none of this drive's");
    const room = this.code.malloc(content.length);
    new Uint8Array(this.code.memory.buffer, room, content.length).set(content);
    const failed = this.code.microvib_set_state(this.at, room);
    this.code.free(room);
    this.#ask(failed);
  }

  free() {
    this.code.microvib_free(this.at);
    this.at = 0;
  }

  #ask(failed) {
    if (failed) throw new Error(this.#read(this.code.microvib_error(this.at)));
  }

  #number(name) {
    const content = encoder.encode(`${name}\0`);
    const room = this.code.malloc(content.length);
    new Uint8Array(this.code.memory.buffer, room, content.length).set(content);
    const which = this.code.microvib_find_output(this.at, room);
    this.code.free(room);
    return which;
  }

  #read(place) {
    const memory = new Uint8Array(this.code.memory.buffer);
    return text.decode(memory.slice(place, memory.indexOf(0, place)));
  }
}
