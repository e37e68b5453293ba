"""Headers in other languages: their words in English, and the encodings of text in scripts that are no Latin one.

The common words of German, French, Italian and Spanish stand beside the English ones in :mod:`asrsim.recordings.names`.
"""

from __future__ import annotations

import re

_GLUED = {
    "関節": "joint", "关节": "joint", "關節": "joint", "관절": "joint", "軸": "axis", "轴": "axis", "축": "axis",
    "角速度": "velocity", "速度": "velocity", "속도": "velocity", "加速度": "acceleration", "角加速度": "acceleration",
    "角度": "angle", "각도": "angle", "位置": "position", "위치": "position",
    "トルク": "torque", "力矩": "torque", "扭矩": "torque", "转矩": "torque", "토크": "torque",
    "目標": "target", "目标": "target", "목표": "target", "指令": "command", "期望": "desired",
    "実際": "actual", "实际": "actual", "실제": "actual",
    "モータ": "motor", "电机": "motor", "電流": "current", "电流": "current",
    "時間": "time", "時刻": "time", "时间": "time", "시간": "time", "温度": "temperature",
}  # fmt: skip
"""Words of scripts that write without blanks."""
_APART = {
    "hoek": "angle", "positie": "position", "snelheid": "velocity", "koppel": "torque", "gewricht": "joint",
    "gewenst": "desired",
    "ângulo": "angle", "posição": "position", "posicao": "position", "velocidade": "velocity", "junta": "joint", "eixo": "axis",
    "kąt": "angle", "pozycja": "position", "prędkość": "velocity", "staw": "joint", "czas": "time",
    "úhel": "angle", "uhel": "angle", "poloha": "position", "rychlost": "velocity", "kloub": "joint", "čas": "time",
}  # fmt: skip
"""Of Dutch, Portuguese, Polish and Czech."""
_GLUED_WORDS = re.compile("|".join(sorted(_GLUED, key=len, reverse=True)))
_APART_WORDS = re.compile(rf"(?<![^\W\d_])(?:{'|'.join(_APART)})(?![^\W\d_])", re.IGNORECASE)
_ENCODINGS = ("gb18030", "shift_jis", "cp949", "big5", "cp1250")
"""What text that is no UTF-8 may be in, beside Latin-1: one in which a word above stands there."""


def in_english(name: str) -> str:
    """The name with the words of other languages that are known here in English."""
    plain = name if name.isascii() else _GLUED_WORDS.sub(lambda match: f" {_GLUED[match[0]]} ", name)
    return _APART_WORDS.sub(lambda match: _APART[match[0].lower()], plain)


def encoding_by_words(start: bytes) -> str | None:
    """The encoding in which the first bytes of a file hold a word that is known here; None for any other."""
    for encoding in _ENCODINGS:
        text = start.decode(encoding, errors="replace")
        words = [*_GLUED_WORDS.findall(text), *(word for word in _APART_WORDS.findall(text) if not word.isascii())]
        # One word may come of letters of another encoding by chance; what cannot be decoded says that it did.
        if words and text.count("\ufffd") < 2:
            return encoding
    return None
