"""modald-scene(5) as its reader has it: structures, effects, loads, sensors, their keys, examples
and laws."""
import json
import re

import numpy as np
from conftest import BUILD


class Key:
    def __init__(self, name, means, says):
        self.name, self.means, self.needed = name, means, "; needed" in says
        self.symbol = (re.match(r"(\w+) in the law", means) or [None, name])[1]
        self.unless = (re.search(r"; needed without (\w+)", says) or [None, None])[1]
        self.words = re.sub(r".*one of ([^;]*);.*", r"\1", says).split(", ")
        example = re.search(rf'; such as "{name}": (.*)$', says)
        self.example = json.loads(example[1]) if example else None


class Part:
    def __init__(self, text):
        head, self.law, *lines = text.splitlines()
        self.law = self.law.strip()
        self.list, self.type, on = re.fullmatch(r'(\w+)(?: of type "(\w+)")?(?: on (.*))?',
                                                head).groups()
        self.structures = on.split(", ") if on else None
        self.keys = [Key(*re.match(r"    (\w+): (.*)", name).groups(), says)
                     for name, says in zip(lines, lines[1:]) if re.match(r"    \w", name)]

    def build(self, **given):
        """Keys that are needed and those that the law names, with their examples."""
        made = {"type": self.type}
        for key in self.keys:
            wanted = ((key.needed and (key.unless is None or key.unless not in made))
                      or re.search(rf"\b{key.name}\b", self.law))
            if key.name in given or (wanted and key.name != "type" and key.example is not None):
                made[key.name] = given.get(key.name, key.example)
        return made


def read_page():
    text = (BUILD / "modald-scene.5").read_text().split(".SH KEYS\n.nf\n")[1].split(".fi\n")[0]
    text = text.replace("\\-", "-").replace("\\e", "\\").replace("\\&", "")
    return [Part(part) for part in text.split("\n\n") if part.strip()]


PAGE = read_page()
EFFECTS = {p.type: p for p in PAGE if p.list == "effects"}
STRUCTURES = {p.type: p for p in PAGE if p.list == "structure"}
LOADS = {p.type: p for p in PAGE if p.list == "excitation"}
SENSORS = {", ".join(p.structures or ["any"]) + (" by " + p.keys[0].name): p for p in PAGE if p.list
           == "sensors"}


# what a law calls; `force`: the function of a lua effect's source
FUNCTIONS = {"cos_of": np.cos, "sin_of": np.sin, "exp_of": np.exp, "tanh_of": np.tanh,
             "sign_of": np.sign, "max_of": np.maximum, "force_of": None, "pi": np.pi}


def arithmetic(text):
    """The printed expression as Python: a quantity beside another is a product, ^ a power, d' the
    velocity; a word with a function's name is one where a bracket follows."""
    words = re.findall(r"\d+\.\d+|\w+(?:\[\w+\])?'?|[-+*/^(),|]", text.replace("d'", "v"))
    made = ""
    for i, word in enumerate(words):
        before = words[i - 1] if i else ""
        called = f"{word}_of" in FUNCTIONS and words[i + 1:i + 2] == ["("]
        if re.match(r"\w|\(", word) and re.match(r"[\w)]", before):
            made += "" if word == "(" and f"{before}_of" in FUNCTIONS else "*"
        made += "**" if word == "^" else f"{word}_of" if called else word
    return made


def evaluate(text, **names):
    return eval(arithmetic(text), {}, {**FUNCTIONS, **names})
