"""What is written between the marks of each suite, by the page's marks (PLACES)."""

from results.figures import SUITES, limits, table
from results.numbers import as_chosen, fixed, hundredths, signed_percent, span, three_digits, two_digits

# ---- accuracy

SHAPES = ("sphere-20mm", "cylinder-10mm", "tilted-plane", "torus-20-8mm")
SPACINGS = ("0.28x0.28x1.0", "0.625x0.625x0.9", "0.3x0.3x0.3")
CHOPPINESS = ("sphere-20mm", "torus-20-8mm")
FOUNDING = SPACINGS[1]

# method -> its variants in the figures, and what the table says of them
VARIANTS = {
    "trilinear": (("trilinear", "voxelised"), ("trilinear-exact-u8", "exact, 8 bits"),
                  ("trilinear-exact-u16", "exact, 16 bits")),
    "b-spline": (("b-spline", "voxelised"), ("b-spline-exact-u8", "exact, 8 bits"),
                 ("b-spline-exact-u16", "exact, 16 bits"), ("b-spline-exact-int16", "exact, int16 coefficients")),
    "gaussian-sphere": (("gaussian-sphere", "voxelised"),),
    "smooth-sphere": (("smooth-sphere", "voxelised"),),
    "stored-normals": (("stored-normals", "voxelised"), ("stored-normals-exact-u8", "exact, 8 bits"),
                       ("stored-normals-exact-u16", "exact, 16 bits")),
}
# method -> what has choppiness, and its quantities
CHOPPY = {
    "trilinear": (("trilinear", "choppiness", "16 bits"), ("trilinear-u8", "choppiness", "8 bits")),
    "b-spline": (("b-spline", "choppiness", "16 bits"), ("b-spline-u8", "choppiness", "8 bits")),
    "gaussian-sphere": (
        ("gaussian-sphere", "choppiness-at-half-voxels", "σ 1 voxel, across half voxels"),
        ("gaussian-sphere", "choppiness-between", "between them"),
        ("gaussian-sphere-sigma-2", "choppiness-at-half-voxels", "σ 2 voxels, across half voxels"),
        ("gaussian-sphere-sigma-2", "choppiness-between", "between them")),
    "smooth-sphere": (("smooth-sphere", "choppiness", "σ 1.5 mm"),),
    "stored-normals": (("stored-normals", "choppiness", "three bytes"),
                       ("stored-normals-oct16", "choppiness", "octahedral, 16 bits"),
                       ("stored-normals-oct24", "choppiness", "octahedral, 24 bits")),
}


def pair(f, path, first="mean", second="p99"):
    return f"{hundredths(f[f'{path}/{first}'])} ({hundredths(f[f'{path}/{second}'])})"


def by_method(method):
    """Direction and magnitude by shape and spacing (of exact samples the founding spacing alone), then choppiness."""
    def lines(f):
        rows = []
        for variant, field in VARIANTS[method]:
            for shape in SHAPES:
                for spacing in (FOUNDING,) if "-exact-" in variant else SPACINGS:
                    path = f"{variant}/{shape}/{spacing}"
                    rows.append([shape, spacing, field,
                                 *(hundredths(f[f"{path}/direction/{leaf}"]) for leaf in ("mean", "p99", "max")),
                                 *(hundredths(f[f"{path}/magnitude/{leaf}"]) for leaf in ("mean", "p99"))])
        head = ("shape", "voxels, mm", "field", "direction, °: mean", "p99", "max", "magnitude, %: mean", "p99")
        items = []
        for variant, quantity, about in CHOPPY[method]:
            of = [f"{shape} " + " / ".join(hundredths(f[f"{variant}/{shape}/{FOUNDING}/{quantity}/{leaf}"])
                                           for leaf in ("p99", "max")) for shape in CHOPPINESS]
            items.append(f"- {about}: {', '.join(of)}")
        return [*table(head, rows), "", f"Choppiness at {FOUNDING} mm, percent of full force per 0.01 mm, p99 / max:", "",
                *items]
    return lines


def accuracy_glance(f):
    ball = "sphere-20mm/" + FOUNDING
    rows = []
    for method in ("trilinear", "b-spline", "smooth-sphere", "stored-normals", "gaussian-sphere"):
        path = f"{method}/{ball}"
        rows.append([f"`{method}`", pair(f, f"{path}/direction"), pair(f, f"{path}/magnitude"),
                     pair(f, f"{path}/choppiness", "p99", "max")])
    return table(("method", "direction, °: mean (p99)", "magnitude, % of full force: mean (p99)",
                  "choppiness, % of full force per 0.01 mm: p99 (max)"), rows)


def accuracy_choppiness(f):
    places = [(CHOPPINESS[0], spacing) for spacing in SPACINGS] + [(CHOPPINESS[1], FOUNDING)]
    kinds = [("trilinear", "choppiness", "trilinear"), ("trilinear-u8", "choppiness", "trilinear, 8 bits"),
             ("b-spline", "choppiness", "b-spline"), ("b-spline-u8", "choppiness", "b-spline, 8 bits"),
             ("smooth-sphere", "choppiness", "smooth-sphere"), ("stored-normals", "choppiness", "stored-normals"),
             ("stored-normals-oct16", "choppiness", "stored-normals, octahedral, 16 bits"),
             ("stored-normals-oct24", "choppiness", "stored-normals, octahedral, 24 bits")]
    for variant, about in (("gaussian-sphere", "gaussian-sphere"), ("gaussian-sphere-sigma-2", "gaussian-sphere, σ 2 voxels")):
        kinds += [(variant, "choppiness", f"{about}, all steps"),
                  (variant, "choppiness-at-half-voxels", "… across half voxels"),
                  (variant, "choppiness-between", "… between them")]
    rows = [[about, *(pair(f, f"{variant}/{shape}/{spacing}/{quantity}", "p99", "max") for shape, spacing in places)]
            for variant, quantity, about in kinds]
    return table(("", *(f"{shape}, {spacing}" for shape, spacing in places)), rows)


def directions(head, variants):
    def lines(f):
        return table((head, *SPACINGS), [[about, *(pair(f, f"{variant}/sphere-20mm/{spacing}{more}/direction")
                                                   for spacing in SPACINGS)] for variant, more, about in variants])
    return lines


# a variant and what follows the spacing in its figures' names, and what the table says of them
VOXELISED = [("trilinear", "", "trilinear"), ("trilinear-u8", "", "trilinear, 8 bits"), ("trilinear", "/sigma-1.0", "trilinear, σ 1.0"),
             ("b-spline", "", "b-spline"), ("b-spline-u8", "", "b-spline, 8 bits"), ("b-spline", "/sigma-1.0", "b-spline, σ 1.0"),
             ("smooth-sphere", "", "smooth-sphere"), ("smooth-sphere", "/sigma-1.0", "smooth-sphere, σ 1.0"),
             ("stored-normals", "", "stored-normals"), ("stored-normals-oct16", "", "stored-normals, octahedral, 16 bits"),
             ("stored-normals-oct24", "", "stored-normals, octahedral, 24 bits")]
EXACT = [("trilinear-exact-u8", "", "trilinear, 8 bits"), ("trilinear-exact-u16", "", "trilinear, 16 bits"),
         ("trilinear-exact-distance-int16", "", "trilinear, distance in int16"), ("b-spline-exact-u8", "", "b-spline, 8 bits"),
         ("b-spline-exact-u16", "", "b-spline, 16 bits"), ("b-spline-exact-int16", "", "b-spline, int16 coefficients"),
         ("b-spline-exact-distance-int16", "", "b-spline, distance in int16"),
         ("stored-normals-exact-u8", "", "stored-normals, 8 bits"), ("stored-normals-exact-u16", "", "stored-normals, 16 bits")]


# ---- contact

TERRACES = ("0.36x0.36x0.7", "0.28x0.28x1.0", "0.625x0.625x0.9")
TILTS = ("2", "5", "10", "20", "35", "60")


def terraces(f):
    rows = [[f"{quantity}, {spacing.replace('x', '×')}",
             *(fixed(f[f"contact/terraces/{quantity}/{spacing}/{tilt}deg"], 1) for tilt in TILTS)]
            for quantity in ("ripple", "direction") for spacing in TERRACES]
    return table(("figure, voxels", *(f"{tilt}°" for tilt in TILTS)), rows)


def contact_seams(f):
    def of(quantity):
        name = f"contact/seams/{quantity}/"
        return {"limit": as_chosen(f.limit(name + TERRACES[0])), "measured": fixed(f.maximum(name + "*"), 3)}
    return {f"`{quantity}`": of(quantity) for quantity in ("drag", "jump", "rise")}


def friction(f):
    """Of the suite stability: what the proxy does."""
    def one(name, write, unit):
        first = f.names("stability/" + name)[0]
        return {"measured": write(f.maximum("stability/" + name)) + unit, "limit": as_chosen(f.limit(first)) + unit}
    def two(value):
        return fixed(value, 2)
    def mm(value):
        return fixed(value, 3)
    return {
        "`friction/static/worst`": one("friction/static/worst", two, " %"),
        "`friction/dynamic/worst`": one("friction/dynamic/worst", two, " %"),
        "`drift/trembling/farthest`": one("drift/trembling/farthest", two_digits, " µm"),
        "`drift/turning/farthest`": one("drift/turning/farthest", two_digits, " µm"),
        "`drift/…/loose`": one("drift/*/loose", two_digits, ""),
        "`pop-through/…/deepest`": one("pop-through/*/deepest", mm, " mm"),
        "`pop-through/…/missed`": one("pop-through/*/missed", two_digits, " %"),
        "`turning/deepest`": one("turning/deepest", mm, " mm"),
        "`turning/shaft-deepest`": one("turning/shaft-deepest", mm, " mm"),
        "`turning/through`, `/not-felt`": {
            "measured": f"{two_digits(f['stability/turning/through'])}, {two_digits(f['stability/turning/not-felt'])}",
            "limit": as_chosen(f.limit("stability/turning/through"))},
    }


# ---- stability

HANDS = [(device, grip) for device in ("premium-1.5", "touch") for grip in ("light-grip", "firm-grip")]
DEVICES = {"premium-1.5": "Premium", "touch": "Touch"}
LOOPS = [("1kHz/delay-0ms", "1 kHz, none"), ("1kHz/delay-1ms", "1 kHz, 1 ms"), ("1kHz/delay-3ms", "1 kHz, 3 ms"),
         ("0.5kHz/delay-2ms", "0.5 kHz, 2 ms"), ("2kHz/delay-0.5ms", "2 kHz, 0.5 ms"),
         ("4kHz/delay-0.25ms", "4 kHz, 0.25 ms"), ("10kHz/delay-0.1ms", "10 kHz, 0.1 ms")]
LIGHT, FIRM = "stability/premium-1.5/light-grip/", "stability/premium-1.5/firm-grip/"
TOUCH_LIGHT = "stability/touch/light-grip/"


def critical(f):
    rows = [[about, *(f"{three_digits(f[f'stability/{device}/{grip}/{loop}/critical'])} "
                      f"({three_digits(f[f'stability/{device}/{grip}/{loop}/settling'])})" for device, grip in HANDS)]
            for loop, about in LOOPS]
    return table(("rate, delay", *(f"{DEVICES[device]}, {grip.replace('-', ' ')}" for device, grip in HANDS)), rows)


def reference(f):
    """What another simulation gave is the rows' own; the program knows it, but tells only how far off it is."""
    delays = (("no delay", "1kHz/delay-0ms"), ("1 ms", "1kHz/delay-1ms"), ("3 ms", "1kHz/delay-3ms"))
    rates = (("500 Hz, 2 ms", "0.5kHz/delay-2ms"), ("2 kHz, 0.5 ms", "2kHz/delay-0.5ms"), ("4 kHz, 0.25 ms", "4kHz/delay-0.25ms"))
    cases = {f"{about}, {at}": path + loop
             for about, path, loops in (("Premium, light grip", LIGHT, delays + rates), ("Premium, firm grip", FIRM, delays),
                                        ("Touch, light grip", TOUCH_LIGHT, delays[1:]))
             for at, loop in loops}
    found = {about: {"palpate": three_digits(f[path + "/critical"]), "off by": signed_percent(f[path + "/from-reference"])}
             for about, path in cases.items()}
    found["Touch, light grip, no delay"] = {"palpate": three_digits(f[TOUCH_LIGHT + "1kHz/delay-0ms/critical"]), "off by": ""}
    return found


def buzz(f):
    def case(device, method, place, grip, quantity):
        return f[f"stability/buzz/{device}/{method}/{place}/{grip}/{quantity}"]
    rows = []
    for grip in ("light-grip", "firm-grip"):
        for method in ("trilinear", "b-spline", "smooth-sphere", "stored-normals"):
            of = ("premium-1.5", method, "gap", grip)
            rows.append([method, grip.split("-", maxsplit=1)[0], fixed(case(*of, "peak-to-peak") / 1000, 2),
                         fixed(case(*of, "rms") / 1000, 2), fixed(case(*of, "dominant"), 0), fixed(case(*of, "force"), 2),
                         fixed(case(*of, "energy-out"), 1)])
    for about, methods in (("gaussian-sphere, proxy", ("gaussian-sphere", "proxy")),
                           ("trilinear, b-spline and stored-normals on ramps",
                            ("trilinear-on-ramps", "b-spline-on-ramps", "stored-normals-on-ramps"))):
        of = [[case("premium-1.5", method, "gap", grip, quantity) / (1000 if quantity in ("peak-to-peak", "rms") else 1)
               for method in methods for grip in ("light-grip", "firm-grip")]
              for quantity in ("peak-to-peak", "rms", "dominant", "force", "energy-out")]
        rows.append([about, "both", *(two_digits(max(values)) for values in of)])
    return table(("method", "grip", "peak-to-peak, mm", "rms, mm", "dominant, Hz", "force, N", "energy out, mJ"), rows)


def energy(f):
    rows = []
    for device, grip in HANDS:
        for method in ("proxy", "trilinear"):
            path = f"stability/energy/{method}/{device}/{grip}/1kHz/"
            given = [f"{fixed(f[f'{path}delay-{delay}ms/given-out/without'], 2)} → "
                     f"{fixed(f[f'{path}delay-{delay}ms/given-out/with'], 3)}" for delay in (0, 1, 3)]
            not_told = ", ".join(fixed(f[f"{path}delay-{delay}ms/not-told/given-out/with"], 2)
                                 for delay in (1, 3)) if method == "proxy" else ""
            rows.append([f"{DEVICES[device]}, {grip.split('-', maxsplit=1)[0]}", method, *given, not_told,
                         fixed(f[path + "delay-0ms/given-out/hidden"], 3),
                         fixed(f[path + "delay-0ms/damped-of-contact"], 0)])
    return table(("device, grip", "method", "no delay", "1 ms", "3 ms", "not told: 1 ms, 3 ms", "hidden",
                  "damped without delay, % of contact"), rows)


def grips(f):
    def of(device, told, quantity):
        return f.span(lambda value: fixed(value, 2), f"stability/grip/{device}/1kHz/delay-1ms/{told}/*/*/{quantity}")
    rows = [["`swing`", "peak-to-peak of the true tip in the fourth second, mm", DEVICES[device],
             *(f.span(two_digits, f"stability/grip/{device}/1kHz/delay-1ms/{told}/*/*/swing") for told in ("told", "not-told")),
             as_chosen(f.limit(f"stability/grip/{device}/1kHz/delay-1ms/told/b-0.3/one-mass/swing"))] for device in DEVICES]
    rows += [["`settled`", "until no 100 ms have more than 0.2 mm, s", DEVICES[device],
              *(of(device, told, "settled") for told in ("told", "not-told")), ""] for device in DEVICES]
    rows += [["`free-tap/rebound`", "speed out of the wall over speed into it, of a tip that nothing holds", DEVICES[device],
              *(fixed(f[f"stability/grip/{device}/1kHz/delay-1ms/{told}/free-tap/rebound"], 2) for told in ("told", "not-told")),
              "told: " + as_chosen(f.limit(f"stability/grip/{device}/1kHz/delay-1ms/told/free-tap/rebound"))] for device in DEVICES]
    return table(("figure", "is", "device", "told", "not told", "limit"), rows)


def skins(f):
    def of(device, rate, hand, quantity, digits):
        return fixed(f[f"stability/grip/{device}/{rate}/with-skin/{hand}/{quantity}"], digits)
    rows = [[hand, DEVICES[device], *(f"{of(device, rate, hand, 'swing', 2)}, {of(device, rate, hand, 'out/largest', 2)}"
                                      for rate in ("1kHz", "0.5kHz", "0.25kHz"))]
            for hand in ("pen-grip", "firm-pen-grip", "fingertip") for device in DEVICES]
    return table(("hand", "device", "1 kHz: swing, mm; given out, mJ", "500 Hz", "250 Hz"), rows)


def dropouts(f):
    rows = []
    for hand in ("light-grip", "firm-grip", "whole-arm"):
        of = [f"stability/dropout/{device}/{hand}/1kHz/delay-1ms/" for device in DEVICES]
        def one(quantity, digits):
            return (fixed(f[path + quantity], digits) for path in of)
        rows.append([hand.replace("-", " "), *one("sink", 2), *one("floor", 2), *one("floor-at-once", 2), *one("back", 0)])
    return table(("hand", "`sink`, mm: Premium", "Touch", "`floor`, mm: Premium", "Touch", "`floor-at-once`, mm: Premium", "Touch",
                  "`back`, ms: Premium", "Touch"), rows)


# ---- removal

HEADS = [("ball", "groove", "ball, a groove"), ("ball", "plane", "ball, a plane"), ("cylinder", "across", "cylinder, across"),
         ("cylinder", "along", "cylinder, along"), ("cylinder", "by-its-side", "cylinder, by its side"),
         ("cylinder", "drilling", "cylinder, drilling"), ("cone", "by-its-side", "cone, by its side"),
         ("cone", "drilling", "cone, drilling")]


def removal_taken(f):
    def stroke(quantity):
        of = [f"removal/{name}/{quantity}" for name in ("drilling", "milling")]
        return {"limit": as_chosen(f.limit(of[0])) + " %", "measured": f"drilling {two_digits(f[of[0]])}, milling {two_digits(f[of[1]])} %"}
    def one(name, unit):
        return {"limit": as_chosen(f.limit(name)) + unit, "measured": two_digits(f[name]) + unit}
    nothing = [f"removal/nothing/{name}" for name in ("motor-off", "cannot-be-cut")]
    return {
        "`removal/<stroke>/between-rates`": stroke("between-rates"),
        "`removal/<stroke>/between-grids`": stroke("between-grids"),
        "`removal/volume/beside-its-sweeps`": one("removal/volume/beside-its-sweeps", " %"),
        "`removal/energy/beyond-work`": {"limit": as_chosen(f.limit("removal/energy/beyond-work")) + " %",
                                         "measured": two_digits(max(0, f["removal/energy/beyond-work"])) + " %"},
        "`removal/nothing/motor-off`, `/cannot-be-cut`": {
            "limit": as_chosen(f.limit(nothing[0])), "measured": f"{two_digits(f[nothing[0]])}, {two_digits(f[nothing[1]])}"},
    }


def removal_heads(f):
    """Each figure with its limit, which are not the same for all."""
    def cell(name):
        return f"{two_digits(f[name])} ({as_chosen(f.limit(name))})"
    rows = [[about, *(cell(f"removal/{head}/{way}/{quantity}")
                      for quantity in ("off-geometry", "counted-off-geometry", "between-rates", "between-grids"))]
            for head, way, about in HEADS]
    return table(("head and way: % (limit)", "surface", "told", "between rates", "between grids"), rows)


def removal_felt(f):
    def mm(value):
        return fixed(value, 3)
    def one(name, unit):
        return {"limit": as_chosen(f.limit(name)) + unit, "measured": two_digits(f[name]) + unit}
    def swing(name):
        of = f"removal/*/*/{name}"
        return {"limit": span(as_chosen(min(f.limit(each) for each in f.names(of))), as_chosen(max(f.limit(each) for each in f.names(of)))) + " mm",
                "measured": f.span(mm, of) + " mm"}
    given = f.names("removal/*/*/given-out")
    return {
        "`removal/new-version/step-beyond-ticks`": one("removal/new-version/step-beyond-ticks", " N"),
        "`removal/new-version/let-go`": one("removal/new-version/let-go", ""),
        "`removal/<plant>/given-out`": {
            "limit": span(as_chosen(min(map(f.limit, given))), as_chosen(max(map(f.limit, given)))) + " mJ",
            "measured": f"{two_digits(f.maximum('removal/*/*/given-out'))} of {f.span(two_digits, 'removal/*/*/put-in')} mJ"},
        "`removal/<plant>/swing`": swing("swing"),
        "`removal/<plant>/swing-settled`": swing("swing-settled"),
        "`removal/<plant>/swing-in-its-hole`": swing("swing-in-its-hole"),
    }


# ---- tissue

def in_order(f, *names, write=two_digits):
    return ", ".join(write(f["tissue/" + name]) for name in names)


def tissue_limit(f, name, unit=" %"):
    return as_chosen(f.limit("tissue/" + name)) + unit


def tissue_bodies(f):
    def nus(name, values):
        return "; ".join(f"ν {nu}: {two_digits(f[f'tissue/{name}/nu-{nu:0<4}'])}" for nu in values)
    return {
        "`patch`": {"limit": tissue_limit(f, "patch/nu-0.30"), "measured": nus("patch", ("0.3", "0.49"))},
        **{f"`{name}`": {"limit": tissue_limit(f, name), "measured": in_order(f, name)}
           for name in ("turned", "cantilever", "cook", "layers-in-series")},
        "`boussinesq`": {"limit": tissue_limit(f, "boussinesq/nu-0.30"), "measured": nus("boussinesq", ("0.3", "0.45", "0.49"))},
        "`convergence/short-of-2`": {"limit": tissue_limit(f, "convergence/short-of-2", ""),
                                     "measured": in_order(f, "convergence/short-of-2")},
    }


def tissue_hertz(f):
    normals = {"along the cells": "along", "at 45°": "45deg", "across a corner": "corner", "askew": "askew"}
    return {f"`{name}`": {"limit": tissue_limit(f, f"hertz/along/{name}", ""),
                          **{about: in_order(f, f"hertz/{normal}/{name}") for about, normal in normals.items()}}
            for name in ("off", "off-at-nu-0.30", "ripple")}


def tissue_contacts(f):
    def layer(nu):
        roots = sorted(f.names(f"tissue/bonded-layer/nu-{nu}/*"))
        return f"ν {nu}: " + " and ".join(two_digits(f[name]) for name in roots)
    return {
        "`flat-punch`": {"limit": tissue_limit(f, "flat-punch"), "measured": in_order(f, "flat-punch")},
        "`bonded-layer`": {"limit": as_chosen(f.limit(f.names("tissue/bonded-layer/**")[0])) + " %",
                           "measured": f"{layer('0.45')}; {layer('0.49')}"},
        "`nodule/work-lost`": {"limit": tissue_limit(f, "nodule/work-lost"), "measured": in_order(f, "nodule/work-lost")},
        "`nodule/work-lost-without-force-aside`": {"measured": in_order(f, "nodule/work-lost-without-force-aside")},
        "`nodule/stiffer`": {"measured": in_order(f, "nodule/stiffer") + " %"},
    }


def tissue_finite(f):
    return {
        **{f"`neo-hookean/{name}`": {"limit": tissue_limit(f, f"neo-hookean/{name}"), "measured": in_order(f, f"neo-hookean/{name}")}
           for name in ("stretched", "linear-off", "most-squeezed")},
        "`neo-hookean/frame-off`, `frame-time`": {
            "measured": f"{in_order(f, 'neo-hookean/frame-off')} %, {in_order(f, 'neo-hookean/frame-time')} ms"},
    }


def tissue_tick(f):
    def ways(prefix, way, speeds):
        return {"measured": "; ".join(in_order(f, *(f"{prefix}{way}/{speed}-mm-s/{leaf}" for speed in speeds))
                                      for leaf in ("largest", "mean"))}
    found = {}
    for prefix, about, speeds in (("tick/", "tick/", (20, 50, 100)), ("tick/neo-hookean/", "tick/neo-hookean/", (20, 50))):
        found[f"`{about}pressed/V/largest`, `/mean`"] = ways(prefix, "pressed", speeds)
        found[f"`{about}pressed-on-nodule/…`"] = ways(prefix, "pressed-on-nodule", speeds)
        found[f"`{about}slid-over-nodule/…`"] = ways(prefix, "slid-over-nodule", speeds)
        found[f"`{about}over-nodule/force`, `/stiffness`"] = {
            "measured": in_order(f, prefix + "over-nodule/force", prefix + "over-nodule/stiffness") + " %"}
    found["`tick/at-rest/change`"] = {"limit": tissue_limit(f, "tick/at-rest/change", " N"),
                                      "measured": fixed(f["tissue/tick/at-rest/change"], 3)}
    found["`tick/work-given-out`"] = {"limit": tissue_limit(f, "tick/work-given-out"), "measured": in_order(f, "tick/work-given-out")}
    found["`tick/neo-hookean/at-rest/change`, `work-given-out`"] = {
        "measured": f"{fixed(f['tissue/tick/neo-hookean/at-rest/change'], 3)}, {in_order(f, 'tick/neo-hookean/work-given-out')}"}
    # every speed has limits of its own
    found["`tick/pressed/V/largest`, `/mean`"]["limit"] = "; ".join(
        ", ".join(as_chosen(f.limit(f"tissue/tick/pressed/{speed}-mm-s/{leaf}")) for speed in (20, 50, 100)) + " %"
        for leaf in ("largest", "mean"))
    return found


def tissue_held(f):
    return {
        "`relaxation/pressed/off`, `held/off`": {"limit": tissue_limit(f, "relaxation/pressed/off"),
                                                 "measured": in_order(f, "relaxation/pressed/off", "relaxation/held/off")},
        "`relaxation/swung/H/angle-off`, `size-off`": {
            "limit": tissue_limit(f, "relaxation/swung/1-Hz/angle-off"),
            "measured": "; ".join(in_order(f, *(f"relaxation/swung/{hz}-Hz/{leaf}" for hz in (1, 3, 10)))
                                  for leaf in ("angle-off", "size-off"))},
        "`relaxation/slid-over-nodule/work-given-out`": {
            "limit": tissue_limit(f, "relaxation/slid-over-nodule/work-given-out"),
            "measured": in_order(f, "relaxation/slid-over-nodule/work-given-out")},
    }


def tissue_cut(f):
    def all_of(leaf):
        return "; ".join(in_order(f, *(f"removal/{way}/{speed}-mm-s/{leaf}" for speed in speeds))
                         for way, speeds in (("milled-beside", (10, 40)), ("trimmed-under", (2, 5))))
    return {
        "`removal/milled-beside/V/lag`, `…/trimmed-under/V/lag`": {
            "limit": tissue_limit(f, "removal/milled-beside/10-mm-s/lag"), "measured": all_of("lag")},
        "`removal/…/behind`": {"measured": all_of("behind")},
        "`removal/…/change`": {"measured": all_of("change")},
        "`removal/…/follow-time`, `frame-time`": {
            "measured": f"{f.span(two_digits, 'tissue/removal/*/*/follow-time')}, {f.span(two_digits, 'tissue/removal/*/*/frame-time')} ms"},
        "`removal/box-laid-anew/change`": {"limit": tissue_limit(f, "removal/box-laid-anew/change"),
                                           "measured": in_order(f, "removal/box-laid-anew/change")},
    }


def tissue_energy(f):
    def maximum(of):
        without = [name for name in f.names(f"tissue/energy/{of}/**") if "delay-0ms" in name]
        delayed = [name for name in f.names(f"tissue/energy/{of}/**") if "delay-0ms" not in name]
        text = f"at most {two_digits(max(f[name] for name in without))} without delay"
        return text + (f", {two_digits(max(f[name] for name in delayed))} with" if delayed else "")
    return {"10 kPa": {"measured": maximum("10-kPa")}, "100 kPa": {"measured": maximum("100-kPa")},
            "1000 kPa": {"measured": maximum("1000-kPa")}, "10 kPa, neo-Hookean": {"measured": maximum("10-kPa-neo-hookean")},
            "100 kPa, that relaxes": {"measured": maximum("100-kPa-that-relaxes")}}


def tissue_cost(f):
    return {
        "`frame/time`, `compliance-off`": {"limit": tissue_limit(f, "frame/compliance-off"),
                                           "measured": f"{in_order(f, 'frame/time')} ms, {in_order(f, 'frame/compliance-off')} %"},
        "`kernel/time`, `bandwidth-floor`": {
            "measured": f"{in_order(f, 'kernel/time', 'kernel/bandwidth-floor')} ns, {in_order(f, 'kernel/times-floor')}"},
    }


# (suite, name) -> function of the figures that returns the lines of the section, or {first cell of a row: {column:
# text}}
PLACES = {
    **{(suite, "limits"): limits for suite in SUITES},
    **{("accuracy", method): by_method(method) for method in VARIANTS},
    ("accuracy", "glance"): accuracy_glance,
    ("accuracy", "choppiness"): accuracy_choppiness,
    ("accuracy", "voxelised"): directions("voxelised", VOXELISED),
    ("accuracy", "exact"): directions("exactly sampled", EXACT),
    ("contact", "terraces"): terraces,
    ("contact", "seams"): contact_seams,
    ("stability", "proxy"): friction,
    ("stability", "critical"): critical,
    ("stability", "reference"): reference,
    ("stability", "buzz"): buzz,
    ("stability", "energy"): energy,
    ("stability", "grips"): grips,
    ("stability", "skins"): skins,
    ("stability", "dropouts"): dropouts,
    ("removal", "taken"): removal_taken,
    ("removal", "heads"): removal_heads,
    ("removal", "felt"): removal_felt,
    ("tissue", "bodies"): tissue_bodies,
    ("tissue", "hertz"): tissue_hertz,
    ("tissue", "contacts"): tissue_contacts,
    ("tissue", "finite"): tissue_finite,
    ("tissue", "tick"): tissue_tick,
    ("tissue", "held"): tissue_held,
    ("tissue", "cut"): tissue_cut,
    ("tissue", "energy"): tissue_energy,
    ("tissue", "cost"): tissue_cost,
}
