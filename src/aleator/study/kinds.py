"""The base of all sections of study.toml, their choice between kinds, and the kinds of law.

A kind is one alternative of a section, such as `law = "normal"`, built in or of a plug-in."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import lru_cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import UnionType
from typing import (
    Annotated,
    Any,
    Generic,
    Self,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    FiniteFloat,
    PlainValidator,
    PydanticSchemaGenerationError,
    Tag,
    TypeAdapter,
    create_model,
    model_validator,
)
from pydantic_core import PydanticCustomError
from scipy import stats

from aleator.errors import AleatorError, StudyError, disordered, nearest
from aleator.laws import (
    OPEN,
    Beta,
    Between,
    By,
    Constant,
    Free,
    Gamma,
    Law,
    LogNormal,
    Mixture,
    Normal,
    ScipyLaw,
    Specification,
    TruncatedNormal,
    Uniform,
)

LIMITS = {"limits", "bounds", "range", "min", "max", "minimum", "maximum", "lower", "upper", "box"}
"""Keys by which limits are called; `_meant` tells how a table of study.toml writes them."""
LIMITED = {
    "box": "box = [LOWER, UPPER]",
    "value": "value = {lower = LOWER, upper = UPPER}",
    "mean": "mean = {lower = LOWER, upper = UPPER}",
    "sd": "sd = {lower = LOWER, upper = UPPER}",
    "lower": "lower = LOWER, upper = UPPER",
}
"""How limits are written in a table that has the key; the first that it has holds."""

FAULT = "fault"
"""The type of those errors in pydantic that carry a message and a remedy of Aleator."""


class Section(BaseModel):
    """A table of study.toml with known keys: unknown keys and wrong types are refused."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, value: Any) -> Any:
        for key in value if isinstance(value, Mapping) else ():
            if key not in cls.model_fields:
                raise fault(
                    f"there is no such key{nearest(key, cls.model_fields)}",
                    f"{_meant(key, cls)}the keys here are {', '.join(cls.model_fields)}",
                    key,
                )
        return value

    def stated(self) -> dict[str, Any]:
        """The keys that the file states, with their values; all others keep their defaults."""
        return {key: getattr(self, key) for key in self.model_fields_set}


def _meant(key: str, section: type[Section]) -> str:
    """The beginning of a remedy: what is written in place of a key that another table may have."""
    if key in LIMITS:
        keys = section.model_fields
        return next(
            (f"write limits as {how}; " for name, how in LIMITED.items() if name in keys), ""
        )
    if key in ("constant", "constants") and "parameters" in section.model_fields:
        return 'a constant is a parameter: [parameters.NAME], law = "constant", value = NUMBER; '
    return ""


def _law(value: Any) -> ChosenKind[Law]:
    """The law that a table of study.toml chooses; a function, because `LAWS` is defined later."""
    return LAWS.read(value)


class FreeSection(Section):
    """A hyperparameter to be identified: `{lower = 0.5, upper = 1.4, start = 1.0}`.

    `prior` is a law with numbers as its keys: `prior = {law = "normal", mean = 1.0, sd = 0.1}`.
    `{between = [0.9, 1.1]}` is a hyperparameter that is only bounded, and not identified.
    """

    lower: FiniteFloat | None = None
    upper: FiniteFloat | None = None
    start: FiniteFloat | None = None
    prior: Annotated[Any, PlainValidator(_law)] = None
    between: Annotated[list[FiniteFloat], Field(min_length=2, max_length=2)] | None = None

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        low, high, start = self.lower, self.upper, self.start
        if self.between is not None:
            if self.model_fields_set - {"between", "start"}:
                raise fault(
                    "a value that is only bounded has no limits of a search and no prior",
                    "keep between, or else lower, upper and prior",
                    "between",
                )
            low, high = self.between
        if low is not None and high is not None and not low < high:
            raise fault(*disordered(low, high))
        for bad, side, bound in (
            (low is not None and start is not None and start < low, "below lower", low),
            (high is not None and start is not None and start > high, "above upper", high),
        ):
            if bad:
                raise fault(f"start {start:g} is {side} {bound:g}", "move it between them")
        return self


def fault(problem: str, remedy: str, key: str = "") -> PydanticCustomError:
    """A pydantic error with a problem and a remedy; `key` is empty if it is about a whole table."""
    return _error(key, f": {problem}", remedy)


def missing(key: str, remedy: str) -> PydanticCustomError:
    """A pydantic error that says that a table lacks a key."""
    return _error(key, " is missing", remedy)


def unknown(key: str, value: object, kinds: Sequence[str], group: str) -> PydanticCustomError:
    """A pydantic error about a key whose value is no known kind, built in or of a plug-in."""
    problem = f" = {in_toml(value)} is not known{nearest(str(value), kinds)}"
    remedy = f"choose one of {', '.join(kinds)}, or install the plug-in with this entry point"
    return _error(key, problem, f"{remedy} of {group}")


def _error(key: str, problem: str, remedy: str) -> PydanticCustomError:
    context = {"key": key, "problem": problem, "remedy": remedy}
    return PydanticCustomError(FAULT, "{key}{problem}", context)


def in_toml(value: object, most: int = 60) -> str:
    """The text of a value as TOML writes it, cut to `most` characters.

    >>> in_toml(True), in_toml("text"), in_toml([1.0, "a"])
    ('true', '"text"', '[1.0, "a"]')
    """
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    text = text.replace("'", '"')
    return text if len(text) <= most else text[: most - 3] + "..."


def form(value: Any) -> str:
    """Whether a value in study.toml is a table, a list, a text or a number.

    >>> form({"lower": 0.0}), form([1]), form("a"), form(1)
    ('table', 'list', 'text', 'number')
    """
    if isinstance(value, Mapping | Section):
        return "table"
    return "list" if isinstance(value, list) else "text" if isinstance(value, str) else "number"


BY_FORM = Discriminator(form)
"""A rule for pydantic: it chooses between alternative types of a key by the form of the value."""

Spec = Annotated[
    Annotated[FiniteFloat, Tag("number")] | Annotated[FreeSection, Tag("table")], BY_FORM
]


class FormulaSection(FreeSection):
    """A hyperparameter that depends on covariates: `{formula = "1 + temperature", lower = 0, ...}`.

    `terms` has a number or limits for each coefficient of the formula, by name.
    """

    formula: str
    terms: dict[str, Spec] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _no_prior(self) -> Self:
        if self.prior is not None:
            raise fault(
                "a formula has no prior",
                "give one to its coefficients: terms = {NAME = {lower = ..., upper = ..., "
                "prior = {...}}}",
                "prior",
            )
        return self


def _formula(text: str) -> str:
    try:
        float(text)
    except ValueError:
        return text
    raise fault(f"{in_toml(text)} is a text", f"write the number without quotes: {text}")


def _form_of_law(value: Any) -> str:
    formula = isinstance(value, FormulaSection) or (
        isinstance(value, Mapping) and ("formula" in value or "terms" in value)
    )
    return "formula table" if formula else form(value)


LawSpec = Annotated[
    Annotated[FiniteFloat, Tag("number")]
    | Annotated[FreeSection, Tag("table")]
    | Annotated[Annotated[str, AfterValidator(_formula)], Tag("text")]
    | Annotated[FormulaSection, Tag("formula table")],
    Discriminator(_form_of_law),
]
"""The type of a key for a hyperparameter of a law: a number, limits, or a formula."""


def specification(spec: FiniteFloat | str | FreeSection) -> Specification:
    """The library's specification of a hyperparameter, from the value of its key.

    A number is a fixed value, a table has the limits of a free hyperparameter or the bounds of one
    that is only bounded, and a text is a formula of covariates.

    >>> specification(FreeSection(lower=0.0, upper=1.0))
    Free(lower=0.0, upper=1.0, start=None, prior=None)
    >>> specification("1 + temperature").formula
    '1 + temperature'
    """
    if isinstance(spec, str):
        return By(spec)
    if isinstance(spec, FormulaSection):
        terms = {name: specification(term) for name, term in spec.terms.items()}
        return By(spec.formula, spec.lower, spec.upper, spec.start, terms)
    if not isinstance(spec, FreeSection):
        return spec
    if spec.between is not None:
        lower, upper = spec.between
        return Between(lower, upper, spec.start)
    prior = None if spec.prior is None else spec.prior.build(Path())
    return Free(spec.lower, spec.upper, spec.start, prior)


T = TypeVar("T")

FOLDER = "folder"
"""The name of the argument that receives the folder of the study; it is no key of the file."""


@dataclass(frozen=True)
class ChosenKind(Generic[T]):
    """The kind that a section of study.toml chose, with its checked keys.

    `maker` builds the value of the library from the keys. `origin` names the plug-in that provides
    the kind; it is empty for a built-in kind.
    """

    kind: str
    keys: Section
    maker: Callable[..., T]
    origin: str = ""

    def build(self, folder: Path) -> T:
        """The value of the library, such as a law; `folder` is the folder of the study.

        Raises AleatorError if the library or the plug-in refuses the keys.
        """
        own = inspect.signature(self.maker).parameters
        given = {key: value for key, value in self.keys.stated().items() if key in own}
        arguments = {k: folder / v if isinstance(v, Path) else v for k, v in given.items()}
        if FOLDER in own:
            arguments[FOLDER] = folder
        try:
            return self.maker(**arguments)
        except Exception as error:
            if isinstance(error, AleatorError) or not self.origin:
                raise
            raise StudyError(
                f"{self.origin} refuses these keys: {_described(error)}", "correct the keys"
            ) from error


@dataclass(frozen=True)
class Kinds(Generic[T]):
    """The kinds that a section can choose by name: the built-in ones, and those of plug-ins.

    Each kind has a maker: a class or a function, or its name "module:name", which is imported when
    the kind is chosen. The keys of the section are the arguments of the maker. The type of a key
    follows from the annotation of the argument (`Specification`: a number or a table; `tuple`: a
    list; `Path`: a file relative to the study). A key may be left out if its argument has a
    default. The argument `folder` receives the folder of the study. An argument whose type does not
    exist in TOML needs a default, and is no key.

    `group` is the group of entry points of plug-ins. `key` is the key that names the kind; if it is
    left out of the file, `default` is chosen. If `key` is empty, a section chooses a kind by a key
    with the name of that kind. `common` has the keys that every kind takes. A plug-in cannot
    replace a built-in kind.

    >>> from aleator.laws import Normal
    >>> laws = Kinds("aleator.laws", "law", {"normal": Normal})
    >>> chosen = laws.read({"law": "normal", "mean": {"lower": 0.0, "upper": 1.0}, "sd": 0.1})
    >>> chosen.build(Path())
    Normal(mean=Free(lower=0.0, upper=1.0, start=None, prior=None), sd=0.1)
    """

    group: str
    key: str
    built_in: Mapping[str, Callable[..., T] | str]
    default: str = ""
    common: type[Section] = Section

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all kinds that a section can choose, the built-in ones first."""
        return (*self.built_in, *sorted({*entry_points(group=self.group).names} - {*self.built_in}))

    def read(self, value: Any) -> ChosenKind[T]:
        """The kind that a table of study.toml chooses, with its keys checked.

        Raises errors of pydantic: for a missing or unknown kind, a plug-in that cannot be imported,
        an unknown key, and a value of the wrong type.
        """
        if not isinstance(value, Mapping):
            self.common.model_validate(value)
        kind = self._kind(value)
        maker, origin = self._maker(kind)
        section = self._section(maker, origin)
        for key in value:
            self._not_of_another(str(key), kind, section)
        return ChosenKind(kind, section.model_validate(value), maker, origin)

    def section(self, kind: str) -> type[Section]:
        """The class that checks the keys of a kind; raises a pydantic error for an unknown one."""
        return self._section(*self._maker(kind))

    def _section(self, maker: Callable[..., T], origin: str) -> type[Section]:
        try:
            return _section(maker, self.key, self.common)
        except (NameError, TypeError) as error:
            raise self._fault(f"{origin} cannot be used: {_described(error)}", "mend it") from error

    def _kind(self, value: Mapping[str, Any]) -> str:
        if self.key:
            kind = value.get(self.key, self.default)
            if not kind:
                raise missing(
                    self.key, f'say which it is: {self.key} = "{next(iter(self.built_in))}"'
                )
            return str(kind)
        chosen = [kind for kind in self.built_in if kind in value] or [
            kind for kind in self.names if kind in value
        ]
        if len(chosen) == 1:
            return chosen[0]
        if chosen:
            raise fault(f"{' and '.join(chosen)} are both given", "keep one of them")
        meant = "".join(filter(None, (nearest(str(key), self.names) for key in value)))
        raise fault(
            f"it names none of the {self.group.rpartition('.')[2]}{meant}",
            f"write one of {', '.join(f'{name} = ...' for name in self.names)}",
        )

    def _maker(self, kind: str) -> tuple[Callable[..., T], str]:
        """The class or function that makes a kind, and the name of its plug-in ("" if built in)."""
        if kind in self.built_in:
            return _imported(self.built_in[kind]), ""
        found = [*entry_points(group=self.group, name=kind)]
        if not found:
            raise unknown(self.key, kind, self.names, self.group)
        if len(found) > 1:
            raise self._fault(
                f"'{kind}' is offered by {' and by '.join(_origin(point) for point in found)}",
                "uninstall one of them",
            )
        origin = _origin(found[0])
        try:
            maker: Callable[..., T] = found[0].load()
        except (Exception, SystemExit) as error:
            raise self._fault(
                f"{origin} cannot be imported: {_described(error)}",
                "mend it, install what it needs, or uninstall it",
            ) from error
        if not callable(maker):
            raise self._fault(f"{origin} is no class or function", "mend its entry point")
        return maker, origin

    def _not_of_another(self, key: str, kind: str, section: type[Section]) -> None:
        """Raise a pydantic error if a key has a meaning for another built-in kind only."""
        if key in section.model_fields:
            return
        for other, maker in self.built_in.items():
            if key in _section(_imported(maker), self.key, self.common).model_fields:
                here = f'{self.key} = "{kind}"' if self.key else kind
                there = f'{self.key} = "{other}"' if self.key else other
                raise fault(
                    f"it has no meaning for {here}",
                    f"{_meant(key, section)}the keys here are {', '.join(section.model_fields)}; "
                    f"or write {there}",
                    key,
                )

    def _fault(self, problem: str, remedy: str) -> Exception:
        return fault(problem, remedy, self.key)


def _imported(maker: Callable[..., T] | str) -> Callable[..., T]:
    if not isinstance(maker, str):
        return maker
    module, name = maker.split(":")
    found: Callable[..., T] = getattr(import_module(module), name)
    return found


@lru_cache(maxsize=64)
def _section(maker: Callable[..., Any], key: str, common: type[Section]) -> type[Section]:
    """The class that checks the keys of a kind: the arguments of its maker, and the common keys.

    Raises NameError or TypeError for an annotation that cannot be the type of a key.
    """
    keys: dict[str, Any] = {key: (str, "")} if key else {}
    for name, parameter in inspect.signature(maker).parameters.items():
        if name == FOLDER or parameter.kind not in (
            parameter.KEYWORD_ONLY,
            parameter.POSITIONAL_OR_KEYWORD,
        ):
            continue
        if name in keys or name in common.model_fields:
            raise TypeError(f"its argument '{name}' is a key of every kind")
        required = parameter.default is parameter.empty
        kind = _key_type(_types(maker).get(name, Any))
        if _is_known(kind):
            keys[name] = (kind, ... if required else parameter.default)
        elif required:
            raise TypeError(f"its argument '{name}' has no default, and TOML no such type")
    return create_model("Keys", __base__=common, **keys)


def _types(maker: Callable[..., Any]) -> dict[str, Any]:
    if is_dataclass(maker):
        names = {field.name for field in fields(maker) if field.init}
        if names == {*inspect.signature(maker).parameters}:
            return get_type_hints(maker, include_extras=True)
    made = maker.__init__ if isinstance(maker, type) else maker  # type: ignore[misc]
    return get_type_hints(made, include_extras=True)


def _key_type(hint: Any) -> Any:
    """The type that pydantic checks a key for, from the type hint of the argument it becomes."""
    parts = get_args(hint)
    if hint is Path:
        return Annotated[str, AfterValidator(lambda text: Path(text))]
    if get_origin(hint) is tuple:
        least, most = (0, None) if parts[-1] is ... else (len(parts), len(parts))
        size = Field(min_length=least, max_length=most)
        item = _key_type(parts[0])
        return Annotated[list[item], size, AfterValidator(tuple)]  # type: ignore[valid-type]
    if get_origin(hint) not in (Union, UnionType):
        return hint
    if Free in parts:
        rest = [part for part in parts if part not in (Free, float)]
        return Union[Annotated[LawSpec, AfterValidator(specification)], *rest]
    return Union[*(_key_type(part) for part in parts)]


def _is_known(kind: Any) -> bool:
    try:
        TypeAdapter(kind)
    except PydanticSchemaGenerationError:
        return False
    return True


def _origin(point: EntryPoint) -> str:
    """The name of a plug-in, its object and its package, as messages show them."""
    of = f" of {point.dist.name} {point.dist.version}" if point.dist else ""
    return f"the plug-in '{point.name}' ({point.value}{of})"


def _described(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}".rstrip(": ")


# ------------------------------------------------------------------------------------ laws


def uniform(
    box: tuple[float, float] | None = None,
    mean: Specification | None = None,
    sd: Specification | None = None,
) -> Uniform:
    """A uniform law: fixed between the two ends of `box`, or identified by its mean and sd."""
    if box is None:
        return Uniform(OPEN if mean is None else mean, OPEN if sd is None else sd)
    if mean is not None or sd is not None:
        raise StudyError(
            "a uniform law has either a box, and is then known, or mean and sd",
            "delete box, or mean and sd",
        )
    return Uniform.between(*box)


def scipy_law(
    distribution: str,
    args: dict[str, float] | None = None,
    mean: Specification | None = None,
    sd: Specification | None = None,
) -> ScipyLaw:
    """A law of scipy.stats: fixed by `args`, or shifted and scaled to `mean` and `sd`.

    Raises StudyError for an unknown distribution or argument.
    """
    kind = getattr(stats, distribution, None)
    if not isinstance(kind, stats.rv_continuous):
        names = [name for name, one in vars(stats).items() if isinstance(one, stats.rv_continuous)]
        raise StudyError(
            f'distribution = "{distribution}": scipy.stats has no continuous '
            f"distribution of that name{nearest(distribution, names)}",
            'write its name in scipy.stats, such as distribution = "weibull_min"',
        )
    given, shapes = args or {}, (kind.shapes or "").replace(",", " ").split()
    lacking = [name for name in shapes if name not in given]
    strange = [name for name in given if name not in (*shapes, "loc", "scale")]
    for name in strange + lacking:
        problem = "needs it" if name in lacking else "does not take it"
        raise StudyError(
            f'args.{name}: "{distribution}" {problem}',
            f"its arguments are {', '.join([*shapes, 'loc', 'scale'])}",
        )
    return ScipyLaw(kind(**given), mean, sd)


def mixture(
    components: tuple[Annotated[ChosenKind[Law], PlainValidator(_law)], ...],
    shares: tuple[Specification, ...] | None = None,
    folder: Path = Path(),
) -> Mixture:
    """A mixture of laws: each component is a table of study.toml, with its share."""
    for number, component in enumerate(components, start=1):
        if isinstance(component.keys, LawSection) and component.keys.level:
            raise StudyError(f"component {number} of a mixture has a level", "take the level away")
    return Mixture(tuple(component.build(folder) for component in components), shares)


class LawSection(Section):
    """Keys of every law: the `unit` of the parameter, and the `level` that it belongs to.

    The unit is shown on axes and in tables. The level is the column of groups of experiments that
    share a draw.
    """

    unit: str = ""
    level: str = ""


LAWS: Kinds[Law] = Kinds(
    "aleator.laws",
    "law",
    {
        "truncated_normal": TruncatedNormal,
        "normal": Normal,
        "uniform": uniform,
        "beta": Beta,
        "gamma": Gamma,
        "lognormal": LogNormal,
        "scipy": scipy_law,
        "mixture": mixture,
        "constant": Constant,
    },
    common=LawSection,
)
"""`law = "..."`: the kinds of law that a parameter can have."""
