"""Numbers in sentences of the pages, and the figure that each comes from (CLAIMS)."""

import re

from results.figures import Missing
from results.tables import DEVICES, FIRM, FOUNDING, LIGHT, TILTS, TOUCH_LIGHT

NUMBER = r"([−-]?(?:\d{1,3}(?: \d{3})+|\d+)(?:\.\d+)?)"
TRILINEAR, B_SPLINE = "trilinear/sphere-20mm/", "b-spline/sphere-20mm/"
EXACT_B_SPLINE = f"b-spline-exact-{{}}/sphere-20mm/{FOUNDING}/direction/"
STEEP = {quantity: [f"contact/terraces/{quantity}/*/{tilt}deg" for tilt in TILTS[1:]]
         for quantity in ("ripple", "direction", "drag")}
NORMALS_GAP = "stability/buzz/touch/stored-normals/gap/"
RAMPS_INSIDE = "stability/buzz/{}/b-spline-on-ramps/inside/{}/{}"
ENERGY = "stability/energy/"
TOUCH_HELD = "stability/energy/{}/touch/light-grip/1kHz/delay-0ms/deepest/{}"
RECOMMENDED = {device: f"stability/{device}/*/1kHz/delay-1ms/margin" for device in DEVICES}
FOLLOWS = {"touch": "stability/following/touch/**/", "premium-1.5": "stability/following/premium-1.5/**/"}
CLOSED = ("tissue/cantilever", "tissue/cook", "tissue/layers-in-series", "tissue/boussinesq/*")
HERTZ = "tissue/hertz/*/"


def figure(name, scale=1):
    return lambda f: f[name] * scale


def limit(name):
    return lambda f: f.limit(f.names(name)[0])


def maximum(*patterns):
    return lambda f: f.maximum(*patterns)


def minimum(*patterns):
    return lambda f: f.minimum(*patterns)


def samples(pattern):
    return lambda f: sum(f.figures[name]["n"] for name in f.names(pattern))


# Suite, page, sentence as it stands there with {} for each number, then the figure that each number is. Of numbers that
# tables give already, those that sentences repeat.
CLAIMS = [
    ("accuracy", "accuracy.md", "| union Gaussian, σ 1.5 mm | {} ({}) |",
     figure(f"{TRILINEAR}{FOUNDING}/direction/mean"), figure(f"{TRILINEAR}{FOUNDING}/direction/p99")),
    ("accuracy", "accuracy.md", "At 0.28×0.28×1.0 mm the worst 1 % of directions on a sphere is {}° to {}° off.",
     *(bound(*(f"{method}/sphere-20mm/0.28x0.28x1.0/direction/p99" for method in
               ("trilinear", "b-spline", "smooth-sphere", "stored-normals"))) for bound in (minimum, maximum))),
    ("accuracy", "accuracy.md", "the B-spline is off by {}° ({}°), some",
     figure(EXACT_B_SPLINE.format("u16") + "mean"), figure(EXACT_B_SPLINE.format("u16") + "p99")),
    ("accuracy", "accuracy.md", "From 8 bits it is off by {}° ({}°):",
     figure(EXACT_B_SPLINE.format("u8") + "mean"), figure(EXACT_B_SPLINE.format("u8") + "p99")),
    ("accuracy", "accuracy.md", "and jumps reach {} %.", maximum("gaussian-sphere/sphere-20mm/*/choppiness/max")),
    ("accuracy", "comparisons.md", "| direction of `trilinear`, sphere, 0.28×0.28×1.0 mm, mean (p99) | {}° ({}°) |",
     figure(TRILINEAR + "0.28x0.28x1.0/direction/mean"), figure(TRILINEAR + "0.28x0.28x1.0/direction/p99")),
    ("accuracy", "comparisons.md", "| the same, 0.625×0.625×0.9 mm | {}° ({}°) | 0.82° (3.8°)",
     figure(f"{TRILINEAR}{FOUNDING}/direction/mean"), figure(f"{TRILINEAR}{FOUNDING}/direction/p99")),
    ("accuracy", "comparisons.md", "| direction of `b-spline`, 0.28×0.28×1.0 mm | {}° ({}°) |",
     figure(B_SPLINE + "0.28x0.28x1.0/direction/mean"), figure(B_SPLINE + "0.28x0.28x1.0/direction/p99")),
    ("accuracy", "comparisons.md", "| the same, 0.625×0.625×0.9 mm | {}° ({}°) | 0.67° (2.7°)",
     figure(f"{B_SPLINE}{FOUNDING}/direction/mean"), figure(f"{B_SPLINE}{FOUNDING}/direction/p99")),

    ("contact", "contact.md", "from 5° on the force ripples by {} to {} %, and its direction is within {}°",
     minimum(*STEEP["ripple"]), maximum(*STEEP["ripple"]), maximum(*STEEP["direction"])),
    ("contact", "contact.md", "| a drag of {} N at 1 N; no jump in", maximum("contact/seams/drag/*")),
    ("contact", "contact.md", "| within 0.1 % on planes, {} % from labels |", maximum("contact/layers/*/force-off")),
    ("contact", "contact.md", "largest less smallest force, percent of 1 N | {}; {} at 2°; on 0.625×0.625×0.9 mm {} at 20 to 35° |",
     limit("contact/terraces/ripple/*/10deg"), limit("contact/terraces/ripple/*/2deg"),
     limit("contact/terraces/ripple/0.625x0.625x0.9/20deg")),
    ("contact", "contact.md", "to the plane's normal, degrees | {}; {} at 2° |",
     limit("contact/terraces/direction/*/10deg"), limit("contact/terraces/direction/*/2deg")),
    ("contact", "contact.md", "would rest on the plane, mm | {} |", limit("contact/terraces/sink/*/*")),
    ("contact", "contact.md", "mean force against the way, percent of 1 N | {}; none at 2° |", limit("contact/terraces/drag/*/5deg")),
    ("contact", "contact.md", "`sink` is at most {} mm, `drag` at most {} % from 5° on.",
     maximum("contact/terraces/sink/*/*"), maximum(*STEEP["drag"])),
    ("contact", "contact.md", "Measured {} and {}, with a limit of {}.",
     maximum("contact/layers/*/force-off"), maximum("contact/layers/*/share-off"), limit("contact/layers/*/force-off")),
    ("contact", "contact.md", "Measured {} of {} each, with a limit of {}.",
     maximum("contact/sheets/*/*"), samples("contact/sheets/*/through"), limit("contact/sheets/*/through")),
    ("contact", "contact.md", "**Planes of 2°** keep a ripple of {} to {} %.",
     minimum("contact/terraces/ripple/*/2deg"), maximum("contact/terraces/ripple/*/2deg")),
    ("stability", "contact.md", "| within {} % static, {} % dynamic |",
     figure("stability/friction/static/worst"), figure("stability/friction/dynamic/worst")),

    ("stability", "stability.md", "with 1 ms of delay is {} N/mm for a *simulated* Premium and {} N/mm for a *simulated* Touch.",
     minimum(RECOMMENDED["premium-1.5"]), minimum(RECOMMENDED["touch"])),
    ("stability", "stability.md", "between two plates by half a millimetre at {} Hz.",
     figure("stability/buzz/premium-1.5/trilinear/gap/light-grip/dominant")),
    ("stability", "stability.md", "the passivity controller leaves at most {} mJ of up to {} mJ.",
     maximum(ENERGY + "*/*/*/1kHz/delay-0ms/given-out/with"), maximum(ENERGY + "*/*/*/1kHz/delay-0ms/given-out/without")),
    ("stability", "stability.md", "lets a tip that presses with 1 N sink by {} to {} mm.",
     minimum("stability/dropout/**/sink"), maximum("stability/dropout/**/sink")),
    ("stability", "stability.md", "`passive` at 1 kHz is {} N/mm for the Premium and {} N/mm for the Touch.",
     figure(LIGHT + "1kHz/delay-1ms/passive"), figure(TOUCH_LIGHT + "1kHz/delay-1ms/passive")),
    ("stability", "stability.md", "| {} | `critical`: every touch", figure(LIGHT + "1kHz/delay-1ms/critical")),
    ("stability", "stability.md", "| {} | `margin`: 0.6 of {}. Recommended is {},",
     figure(LIGHT + "1kHz/delay-1ms/margin"), figure(LIGHT + "1kHz/delay-1ms/critical"), minimum(RECOMMENDED["premium-1.5"])),
    ("stability", "stability.md", "| {} | `settling`: quiet in the second second already |", figure(LIGHT + "1kHz/delay-1ms/settling")),
    ("stability", "stability.md", "is within {} to {} % of that, with a limit of {} %:",
     minimum("stability/theory/**"), maximum("stability/theory/**"), limit("stability/theory/**")),
    ("stability", "stability.md", "It stops all but `stored-normals`: {} mm at {} Hz with the light grip, {} mm at {} Hz with the firm one.",
     *(figure(f"{NORMALS_GAP}{grip}/{quantity}", scale) for grip in ("light-grip", "firm-grip")
       for quantity, scale in (("peak-to-peak", 1e-3), ("dominant", 1)))),
    ("stability", "stability.md", "with both devices and grips: {} to {} N with the Premium, {} to {} N with the Touch,",
     *(bound(f"stability/buzz/{device}/*/wall/*/force") for device in DEVICES for bound in (minimum, maximum))),
    ("stability", "stability.md", "By {} mm at {} Hz with the Premium in the light grip, {} mm at {} Hz in the firm one, and by {} and {} mm with the Touch.",
     *(figure(RAMPS_INSIDE.format("premium-1.5", grip, quantity), scale) for grip in ("light-grip", "firm-grip")
       for quantity, scale in (("peak-to-peak", 1e-3), ("dominant", 1))),
     *(figure(RAMPS_INSIDE.format("touch", grip, "peak-to-peak"), 1e-3) for grip in ("light-grip", "firm-grip"))),
    ("stability", "stability.md", "what an encoder hides, and {} % of what it is without the controller. Twice as stiff, at most {} mJ are given out.",
     limit(ENERGY + "*/*/*/1kHz/delay-0ms/part-given-out"), maximum(ENERGY + "**/twice-as-stiff/given-out/with")),
    ("stability", "stability.md", "A lightly held Touch is up to {} mm deep instead of {} (proxy), and {} instead of {} (trilinear).",
     *(figure(TOUCH_HELD.format(method, how)) for method in ("proxy", "trilinear") for how in ("with", "without"))),
    ("stability", "stability.md", "The most that is given out is {} mJ at 1 and 10 kHz, and {} mJ at 250 Hz",
     maximum(ENERGY + "**/1kHz/delay-0ms/unpunctual/**given-out/with", ENERGY + "**/10kHz/delay-0ms/unpunctual/**given-out/with"),
     maximum(ENERGY + "**/0.25kHz/delay-0ms/unpunctual/**given-out/with")),
    ("stability", "stability.md", "With 1 and 3 ms in truth a tip leaves at {} to {} times its speed, with a limit of {}.",
     minimum("stability/grip/**/unknown/free-tap/rebound"), maximum("stability/grip/**/unknown/free-tap/rebound"),
     limit("stability/grip/**/unknown/free-tap/rebound")),
    ("stability", "stability.md", "for 1 ms of delay (Premium {} N/mm, Touch {}).",
     minimum(RECOMMENDED["premium-1.5"]), minimum(RECOMMENDED["touch"])),
    ("stability", "stability.md", "in one tick of the first 100 ms: {} N, with a limit of {}.",
     maximum("stability/dropout/**/kick"), limit("stability/dropout/**/kick")),
    ("stability", "stability.md", "All {} figures are within their limits.", lambda f: f.count_within_limits("stability/no-go/**")),
    ("stability", "stability.md", "a Touch that follows is recommended {} N/mm, and {} alone; a Premium {} and {}.",
     *(maximum(FOLLOWS[device] + name) for device in ("touch", "premium-1.5") for name in ("recommended", "recommended-alone"))),
    ("stability", "comparisons.md", "another simulation of the same plant | {} to +{} % |",
     minimum("stability/**/from-reference"), maximum("stability/**/from-reference")),
    ("stability", "comparisons.md", "(Colgate & Schenkel 1997) | {} to {} % | theory |",
     minimum("stability/theory/**"), maximum("stability/theory/**")),
    ("stability", "comparisons.md", "**A firm grip without delay** holds {} % less than",
     figure(FIRM + "1kHz/delay-0ms/from-reference", -1)),

    ("removal", "removal.md", "(`pressed`): {} to {} N drilling, {} to {} N settled, {} to {} N in the hole, and {} to {} N with the motor off.",
     *(bound(f"removal/*/*/{name}") for name in ("pressed", "pressed-settled", "pressed-in-its-hole", "pressed-motor-off")
       for bound in (minimum, maximum))),

    ("tissue", "tissue.md", "- Beams, layers and half spaces with a closed form: {} to {} % off, with limits of {} to {} %.",
     minimum(*CLOSED), maximum(*CLOSED), *(lambda f, pick=pick: pick(f.limit(name) for name in f.names(*CLOSED)) for pick in (min, max))),
    ("tissue", "tissue.md", "at most {} % off at ν of 0.45 and 0.49, and {} % at 0.3,", maximum(HERTZ + "off"), maximum(HERTZ + "off-at-nu-0.30")),
    ("tissue", "tissue.md", "over a hidden nodule, is at most {} % of the peak off by the linear law", maximum("tissue/tick/pressed-on-nodule/*/largest")),
    ("tissue", "tissue.md", "A linear frame of {} cells takes {} ms of one thread.", samples("tissue/kernel/time"), figure("tissue/frame/time")),
    ("tissue", "comparisons.md", "soft tissue: beams, layers, half spaces {} to {} %;", minimum(*CLOSED), maximum(*CLOSED)),
]


def number(text):
    return float(text.replace(" ", "").replace("−", "-"))


def compare(pages, figures, claims):
    """A line for each number of a sentence that is not the figure, rounded as the number is."""
    wrong = []
    one_line = {page: " ".join(text.split()) for page, text in pages.items()}
    for suite, page, sentence, *wanted in claims:
        if suite not in figures:
            continue
        pattern = NUMBER.join(re.escape(part) for part in sentence.split("{}"))
        found = re.findall(pattern, one_line.get(page, ""))
        if len(found) != 1:
            raise Missing(f"{page} has the sentence '{sentence}' {len(found)} times, not once")
        shown = found[0] if isinstance(found[0], tuple) else (found[0],)
        if len(shown) != len(wanted):
            raise Missing(f"'{sentence}' has {len(shown)} numbers, and {len(wanted)} figures")
        for text, value in zip(shown, wanted):
            value = value(figures[suite])
            decimals = len(text.partition(".")[2])
            if abs(number(text) - value) > 0.5000001 * 10 ** -decimals:
                wrong.append(f"{page}: '{sentence}' says {text}, {suite} {value:.4g}")
    return wrong
