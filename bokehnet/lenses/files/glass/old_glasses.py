"""Index and Abbe number of glasses and plastics that lens files use and current catalogues omit.

Source: Schott, "Optical glass" catalogue, 1992; plastics from "OpticStudio", catalogue MISC. Names are
without dashes, values nd and Vd.
"""

__all__ = ["OLD_GLASSES"]

OLD_GLASSES = {
    "BK7": (1.51680, 64.17),
    "K5": (1.52249, 59.48),
    "FK5": (1.48749, 70.41),
    "PSK3": (1.55232, 63.46),
    "BAK1": (1.57250, 57.55),
    "BAK4": (1.56883, 56.11),
    "SK2": (1.60738, 56.65),
    "SK4": (1.61272, 58.63),
    "SK5": (1.58913, 61.27),
    "SK14": (1.60311, 60.60),
    "SK15": (1.62299, 58.06),
    "SK16": (1.62041, 60.33),
    "SSK4": (1.61765, 55.14),
    "LAK8": (1.71300, 53.83),
    "LAK9": (1.69100, 54.71),
    "LAK10": (1.72000, 50.41),
    "LAF2": (1.74400, 44.72),
    "BAF10": (1.67003, 47.11),
    "LLF1": (1.54814, 45.75),
    "F5": (1.60342, 38.03),
    "SF2": (1.64769, 33.85),
    "SF8": (1.68893, 31.18),
    "SF10": (1.72825, 28.41),
    "SF11": (1.78472, 25.76),
    "SF15": (1.69895, 30.07),
    "SF57": (1.84666, 23.83),
    "PMMA": (1.491757, 57.44),
    "POLYCARB": (1.585470, 29.91),
    "POLYSTYR": (1.590481, 30.87),
    "WATER": (1.333041, 55.79),
}
