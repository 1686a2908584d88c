// The packets of a run that goes on: the newest flights and messages, in the form that a recording has.

const [FLIGHTS, MESSAGES] = [20_000, 4_000]; // kept; with more, the older half is dropped
const COLUMNS = { sent: Float64Array, delay: Float32Array, from: Uint16Array, to: Uint16Array, lost: Uint8Array };

export class LiveRadio {
  constructor(run) {
    this.traffic = run.traffic;
    this.run = run;
    this.n = 0;
    this.dropped = 0; // messages
    this.codes = { messages: new Map(), sources: new Map() };
    this.room = Object.fromEntries(Object.entries(COLUMNS).map(([name, Type]) => [name, new Type(FLIGHTS)]));
    this.traffic.flights = {};
    this.traffic.log = { of: 0, time: [], source: [], message: [], heard: [], lost: [], texts: [] };
    this.#shown();
  }

  #shown() {
    for (const name of Object.keys(COLUMNS)) this.traffic.flights[name] = this.room[name].subarray(0, this.n);
  }

  /** Flights: time sent, delay, vehicles that send and receive, whether it is lost; five numbers each. */
  fly(numbers) {
    const { room, traffic } = this;
    for (let k = 0; k + 5 <= numbers.length; k += 5) {
      if (this.n === FLIGHTS) {
        for (const array of Object.values(room)) array.copyWithin(0, FLIGHTS / 2);
        this.n = FLIGHTS / 2;
      }
      let i = this.n++;
      for (; i > 0 && room.sent[i - 1] > numbers[k]; i--) for (const array of Object.values(room)) array[i] = array[i - 1];
      Object.keys(COLUMNS).forEach((name, c) => (room[name][i] = numbers[k + c]));
      traffic.longest = Math.max(traffic.longest, numbers[k + 1]);
    }
    this.#shown();
  }

  /** The number of a name among all names of its kind. */
  #code(kind, name, more) {
    const codes = this.codes[kind];
    if (!codes.has(name)) {
      codes.set(name, codes.size);
      this.traffic[kind].push(name);
      more();
    }
    return codes.get(name);
  }

  say(messages, sends) {
    const { traffic } = this;
    const { log } = traffic;
    for (const [time, source, vehicle, message, heard, lost, text, spoken] of messages) {
      log.time.push(time);
      log.source.push(this.#code('sources', source, () => traffic.vehicleOf.push(vehicle)));
      log.message.push(this.#code('messages', message, () => traffic.spoken.push(spoken)));
      log.heard.push(heard);
      log.lost.push(lost);
      log.texts.push(text);
    }
    log.of = sends;
    if (log.time.length <= MESSAGES) return;
    const drop = log.time.length - MESSAGES / 2;
    for (const name of ['time', 'source', 'message', 'heard', 'lost', 'texts']) log[name].splice(0, drop);
    this.dropped += drop;
  }

  count({ links, of, packets, sends }) {
    Object.assign(this.traffic, { links, linksOf: of });
    this.traffic.log.of = sends;
    this.run.packets = packets;
  }
}
