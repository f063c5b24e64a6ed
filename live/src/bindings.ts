// Calls of MuJoCo's bindings, of closures. The bindings write each call as text and have `Function`
// make code of it, which a page would have to allow any text. In the bundle their `Function` is this
// one (build.mjs): it takes from the text which of two kinds of call it is, and makes that.

type Call = (...given: unknown[]) => unknown;

interface WireType {
  toWireType(destructors: unknown[] | null, value: unknown): unknown;
  fromWireType(value: unknown): unknown;
  readValueFromPointer(pointer: number): unknown;
  argPackAdvance: number;
}

interface Values {
  humanName: string;
  throwBindingError: unknown;
  invoker: Call;
  fn: unknown;
  runDestructors(destructors: unknown[]): void;
  retType: WireType;
  classParam: WireType;
  checkArgCount: Call;
  minArgs: number;
  maxArgs: number;
  emval_returnValue?: Call;
}

type Given = Values & Record<string, unknown>;

/** Return what makes a call, once it is given the values that its text names. */
function Bound(...words: string[]): (...values: unknown[]) => unknown {
  const names = words.slice(0, -1);
  const text = words.at(-1)!;
  const kind = KINDS.find(([opening]) => opening.test(text) && names.includes("retType"));
  if (!kind) throw new Error("MuJoCo's bindings ask for a call that this page does not know");
  const count = names.filter((name) => /^argType\d+$/.test(name)).length;
  return (...values) => {
    const given = Object.fromEntries(names.map((name, place) => [name, values[place]])) as Given;
    return kind[1](given, Array.from({ length: count }, (_, place) => given[`argType${place}`] as WireType), text);
  };
}

/** From JavaScript into the engine. */
function inward(given: Given, types: readonly WireType[], text: string): unknown {
  const { humanName, throwBindingError, invoker, fn, retType, classParam, checkArgCount, minArgs, maxArgs } = given;
  const isMethod = text.includes("thisWired = ");
  const keeps = text.includes("var destructors = []");
  const returns = text.includes("return ret;");
  const ends = ["thisWired", ...types.map((_, place) => `arg${place}Wired`)].map((name) => given[`${name}_dtor`] as Call | undefined);
  return function call(this: unknown, ...values: unknown[]): unknown {
    checkArgCount(values.length, minArgs, maxArgs, humanName, throwBindingError);
    const destructors = keeps ? [] : null;
    const own = isMethod ? classParam.toWireType(destructors, this) : undefined;
    const wired = types.map((type, place) => type.toWireType(destructors, values[place]));
    const result = isMethod ? invoker(fn, own, ...wired) : invoker(fn, ...wired);
    if (destructors) given.runDestructors(destructors);
    else [own, ...wired].forEach((value, place) => ends[place]?.(value));
    return returns ? retType.fromWireType(result) : undefined;
  };
}

/** From the engine to a function of JavaScript. */
function outward({ retType, emval_returnValue }: Given, types: readonly WireType[], text: string): unknown {
  const makes = text.includes("new func(");
  const ofObject = text.includes("func.call(obj");
  return (object: unknown, called: Call & (new (...values: unknown[]) => unknown), destructors: unknown, pointer: number): unknown => {
    let at = pointer;
    const values = types.map((type) => {
      const value = type.readValueFromPointer(at);
      at += type.argPackAdvance;
      return value;
    });
    const result = makes ? new called(...values) : Reflect.apply(called, ofObject ? object : values[0], ofObject ? values : values.slice(1));
    return emval_returnValue?.(retType, destructors, result);
  };
}

const KINDS: readonly [RegExp, (given: Given, types: readonly WireType[], text: string) => unknown][] = [
  [/^return function \(obj, func, destructorsRef, args\) \{\n/, outward],
  [/\nreturn function \([arg\d,]*\) \{\ncheckArgCount\(/, inward],
];

export { Bound as Function };
