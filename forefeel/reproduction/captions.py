"""What stands over and under the figures of the flaws."""

TITLES = {
    "flaw_a": "(a) Mass and stiffness can not be told apart",
    "flaw_b": "(b) The update overflows",
    "flaw_c": "(c) The forgetting factor is a memory in samples",
    "flaw_d": "(d) No bias and no friction in the model",
    "flaw_e": "(e) No baseline: simply holding the late force",
    "flaw_f": "(f) The late force paired with the newest motion",
    "thresholds": "Share of the time in which the error is not felt, simulated bench",
}

CAPTIONS = {
    "flaw_a": "With x = sin t, x'' = -x: two columns of the regression are one. The prediction at 1 rad/s "
    "is perfect, at any other frequency it is wrong. The product says what it can not know, keeps mass and "
    "stiffness within physical bounds, and finds both once a second frequency is there.",
    "flaw_b": "At 1 kHz. Left, without noise: in the direction that sin t does not excite, P grows as λ to "
    "the power -k until it passes the largest number that a computer holds (crosses). Right, with 1 mN of "
    "noise: long before that the parameters are arbitrary. The product updates only where there is "
    "information.",
    "flaw_c": "λ = 0.96 with 5 mN noise and 300 ms delay. Left: median of five noises, bars from the lowest "
    "to the highest. With m known nothing is unidentifiable, and what remains is the short memory alone. "
    "The product's memory is 2 s at any rate. Right: clipped at twice the force.",
    "flaw_d": "The paper's simulation at 10 Hz, where its algorithm works best, 300 ms late, without noise. "
    "A bias stays in the error as it is; of Coulomb friction the model takes up the part that looks like "
    "damping. In longer runs either also drives the wind-up of (b).",
    "flaw_e": "rms at 300 ms, each run relative to holding the newest force that has arrived. An error "
    "without the hold beside it is no evidence: where a predictor lies right of the line, doing nothing is "
    "better. Tared: the paper's algorithm on the force less its first value, which spares it most of (d).",
    "flaw_f": "Left, the paper's simulation: paired with the newest motion, the algorithm learns the "
    "delayed force, and its error is that of the hold. Right, the runs, rms relative to the hold. Where the "
    "right pairing is worse, its 25 samples of memory (c) and the missing bias (d) carry it astray over "
    "300 ms, while the wrong one follows the hold.",
    "thresholds": "Simulated bench, three styles of the simulated operator. Full bars and numbers: error "
    "below 29 mN or 7 % of the force, whichever is larger; light bars: 44 mN or 10 %. As shown to the hand, "
    "after force scaling.",
}
