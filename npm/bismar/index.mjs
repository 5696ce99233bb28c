import bismar from "./index.cjs";

export const { BismarError, compare, inspect, look, program, render, version } = bismar;
