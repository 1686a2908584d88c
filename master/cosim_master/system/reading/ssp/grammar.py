"""The grammar of SSP's files: the legal elements and attributes at each place, and those that are not supported.

It covers SSP 1.0 and 2.0, sections 4 to 8. Features of version 2.0 are marked as later, and refused in a file of
version 1.0. Geometry is accepted wherever the standard allows it, and its contents are not checked.
"""

from __future__ import annotations

from cosim_master.files.xml import Form, Grammar
from cosim_master.fmi.description.units import BASE_UNITS

__all__ = [
    "ANNOTATIONS",
    "ANY_TYPE",
    "GRAMMAR",
    "KINDS",
    "KINDS_2",
    "META",
    "SAME_TYPE",
    "SSB",
    "SSC",
    "SSD",
    "SSM",
    "SSV",
    "TRANSFORMATIONS",
    "TYPES",
    "TYPES_2",
    "VALUE_TYPES",
]

SSD = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"
SSC = "{http://ssp-standard.org/SSP1/SystemStructureCommon}"
SSV = "{http://ssp-standard.org/SSP1/SystemStructureParameterValues}"
SSM = "{http://ssp-standard.org/SSP1/SystemStructureParameterMapping}"
SSB = "{http://ssp-standard.org/SSP1/SystemStructureSignalDictionary}"

TYPES = ("Real", "Integer", "Boolean", "String", "Enumeration", "Binary")
TYPES_2 = ("Float64", "Float32", *(f"{sign}Int{width}" for sign in ("", "U") for width in (8, 16, 32, 64)))
SAME_TYPE = {"Float64": "Real", "Int32": "Integer"}
"""Names of SSP 2.0 for types of SSP 1.0: after reading, only the older names are used."""
KINDS = ("input", "output", "parameter", "calculatedParameter", "inout")
KINDS_2 = ("structuralParameter", "constant", "local", "unspecified")
ANNOTATIONS = SSD + "Annotations"
META = (SSC + "MetaData", SSC + "Signature")

_BASE = ("id", "description")
_TOP = (*_BASE, "author", "fileversion", "copyright", "license", "generationTool", "generationDateAndTime")
_META = frozenset(META)


def _ssc(*names: str) -> tuple[str, ...]:
    return tuple(SSC + name for name in names)


def _ssd(*names: str) -> tuple[str, ...]:
    return tuple(SSD + name for name in names)


def _list(plural: str, single: str, *, empty: bool = False) -> Grammar:
    return {plural: Form(children=(single,), repeated=frozenset({single}), mandatory=() if empty else (single,))}


ANY_TYPE = frozenset(_ssc(*TYPES, *TYPES_2))
_CLOCK = frozenset(_ssc("Clock"))
_TYPES_2 = frozenset(_ssc(*TYPES_2))
_TYPE_CHILDREN = (*_ssc(*TYPES, *TYPES_2), *_CLOCK)
VALUE_TYPES = tuple(SSV + name for name in (*TYPES, *TYPES_2))
TRANSFORMATIONS = _ssc(
    "LinearTransformation",
    "BooleanMappingTransformation",
    "IntegerMappingTransformation",
    "EnumerationMappingTransformation",
)
_DIMENSION = SSC + "Dimension"
_MAP_ENTRY = SSC + "MapEntry"

GRAMMAR: Grammar = {
    SSD + "SystemStructureDescription": Form(
        required=("version", "name"),
        optional=_TOP,
        children=(*_ssd("System", "Enumerations", "Units", "DefaultExperiment"), *META, ANNOTATIONS),
        mandatory=_ssd("System"),
        repeated=_META,
        later=_META,
    ),
    SSD + "System": Form(
        required=("name",),
        optional=_BASE,
        children=(
            *_ssd("Connectors", "ElementGeometry", "ParameterBindings"),
            *META,
            *_ssd("Elements", "Connections", "SignalDictionaries", "SystemGeometry", "GraphicalElements"),
            ANNOTATIONS,
        ),
        repeated=_META,
        later=_META,
    ),
    SSD + "Component": Form(
        required=("name",),
        optional=(*_BASE, "source", "type", "implementation"),
        children=(*_ssd("Connectors", "ElementGeometry", "ParameterBindings"), *META, ANNOTATIONS),
        repeated=_META,
        later=_META,
    ),
    SSD + "SignalDictionaryReference": Form(
        required=("name", "dictionary"),
        optional=_BASE,
        children=(*_ssd("Connectors", "ElementGeometry", "ParameterBindings"), *META, ANNOTATIONS),
        repeated=_META,
        later=_META,
    ),
    **_list(SSD + "SignalDictionaries", SSD + "SignalDictionary"),
    SSD + "SignalDictionary": Form(
        required=("name",),
        optional=(*_BASE, "type", "source"),
        children=(SSB + "SignalDictionary", *META),
        repeated=_META,
        later=_META,
    ),
    **_list(SSD + "Connectors", SSD + "Connector"),
    SSD + "Connector": Form(
        required=("name", "kind"),
        optional=_BASE,
        children=(*_TYPE_CHILDREN, _DIMENSION, *_ssd("Clock", "ConnectorGeometry"), ANNOTATIONS),
        choices=(ANY_TYPE | _CLOCK,),
        repeated=frozenset({_DIMENSION, SSD + "Clock"}),
        later=_TYPES_2 | _CLOCK | {_DIMENSION, SSD + "Clock"},
    ),
    SSC + "Clock": Form(
        optional=(
            *("intervalVariability", "intervalDecimal", "shiftDecimal", "supportsFraction", "resolution"),
            *("intervalCounter", "shiftCounter", "priority"),
        )
    ),
    SSD + "Clock": Form(required=("name",)),
    SSD + "Elements": Form(
        children=_ssd("Component", "SignalDictionaryReference", "System"),
        repeated=frozenset(_ssd("Component", "SignalDictionaryReference", "System")),
        filled=True,
    ),
    **_list(SSD + "Connections", SSD + "Connection"),
    SSD + "Connection": Form(
        required=("startConnector", "endConnector"),
        optional=(*_BASE, "startElement", "endElement", "startIndices", "endIndices", "suppressUnitConversion"),
        children=(*TRANSFORMATIONS, *_ssd("ConnectionGeometry"), ANNOTATIONS),
        choices=(frozenset(TRANSFORMATIONS),),
        later=frozenset({"startIndices", "endIndices"}),
    ),
    SSC + "LinearTransformation": Form(optional=("factor", "offset")),
    **{key: value for tag in TRANSFORMATIONS[1:] for key, value in _list(tag, _MAP_ENTRY).items()},
    _MAP_ENTRY: Form(required=("source", "target")),
    **_list(SSD + "ParameterBindings", SSD + "ParameterBinding"),
    SSD + "ParameterBinding": Form(
        optional=(*_BASE, "type", "source", "sourceBase", "prefix"),
        children=(*_ssd("ParameterValues", "ParameterMapping"), *META, ANNOTATIONS),
        repeated=_META,
        later=_META,
    ),
    SSD + "ParameterValues": Form(children=(SSV + "ParameterSet",), mandatory=(SSV + "ParameterSet",)),
    SSD + "ParameterMapping": Form(
        optional=(*_BASE, "type", "source", "sourceBase"),
        children=(SSM + "ParameterMapping", *META),
        repeated=_META,
        later=_META,
    ),
    SSV + "ParameterSet": Form(
        required=("version", "name"),
        optional=_TOP,
        children=(*(SSV + name for name in ("Parameters", "Enumerations", "Units")), *META, SSV + "Annotations"),
        mandatory=(SSV + "Parameters",),
        repeated=_META,
        later=_META,
    ),
    **_list(SSV + "Parameters", SSV + "Parameter", empty=True),
    SSV + "Parameter": Form(
        required=("name",),
        optional=_BASE,
        children=(*VALUE_TYPES, _DIMENSION, *META, SSV + "Annotations"),
        choices=(frozenset(VALUE_TYPES),),
        repeated=_META | {_DIMENSION},
        later=_META | {_DIMENSION} | {SSV + name for name in TYPES_2},
    ),
    **{SSV + name: Form(required=("value",), optional=("unit",)) for name in ("Real", "Float64", "Float32")},
    **{SSV + name: Form(required=("value",)) for name in ("Integer", "Boolean", *TYPES_2[2:])},
    **{
        SSV + name: Form(
            optional=("value", *optional),
            children=(SSV + "Value",),
            repeated=frozenset({SSV + "Value"}),
            later=frozenset({SSV + "Value"}),
        )
        for name, optional in (("String", ()), ("Enumeration", ("name",)), ("Binary", ("mime-type",)))
    },
    SSV + "Value": Form(required=("value",)),
    SSM + "ParameterMapping": Form(
        required=("version",),
        optional=_TOP,
        children=(SSM + "MappingEntry", *META, SSM + "Annotations"),
        repeated=_META | {SSM + "MappingEntry"},
        later=_META,
    ),
    SSM + "MappingEntry": Form(
        required=("source", "target"),
        optional=(*_BASE, "suppressUnitConversion"),
        children=(*TRANSFORMATIONS, SSM + "Annotations"),
        choices=(frozenset(TRANSFORMATIONS),),
    ),
    SSB + "SignalDictionary": Form(
        required=("version",),
        optional=_TOP,
        children=(*(SSB + name for name in ("DictionaryEntry", "Enumerations", "Units")), *META, SSB + "Annotations"),
        repeated=_META | {SSB + "DictionaryEntry"},
        later=_META,
    ),
    SSB + "DictionaryEntry": Form(
        required=("name",),
        optional=_BASE,
        children=(*_TYPE_CHILDREN, _DIMENSION, SSB + "Annotations"),
        choices=(ANY_TYPE | _CLOCK,),
        repeated=frozenset({_DIMENSION}),
        later=_TYPES_2 | _CLOCK | {_DIMENSION},
    ),
    SSD + "DefaultExperiment": Form(optional=("startTime", "stopTime"), children=_ssd("Annotations")),
    SSC + "Annotation": Form(required=("type",), opaque=True),
    **{tag: Form(opaque=True, free=True) for tag in META},
    **{SSC + name: Form(optional=("unit",)) for name in ("Real", "Float64", "Float32")},
    **{SSC + name: Form() for name in ("Integer", "Boolean", "String", *TYPES_2[2:])},
    SSC + "Enumeration": Form(required=("name",)),
    SSC + "Binary": Form(optional=("mime-type",)),
    _DIMENSION: Form(optional=("size", "sizeConnector")),
    SSC + "Unit": Form(
        required=("name",),
        optional=_BASE,
        children=_ssc("BaseUnit", "Annotations"),
        mandatory=_ssc("BaseUnit"),
    ),
    SSC + "BaseUnit": Form(optional=(*BASE_UNITS, "factor", "offset")),
    # The definition of an enumeration; ssc:Enumeration itself is the type of a connector.
    SSC + "Enumeration type": Form(
        required=("name",),
        optional=_BASE,
        children=_ssc("Item", "Annotations"),
        repeated=frozenset(_ssc("Item")),
        mandatory=_ssc("Item"),
    ),
    SSC + "Item": Form(required=("name", "value")),
    **{
        key: value
        for namespace in (SSD, SSC, SSV, SSM, SSB)
        for key, value in _list(namespace + "Annotations", SSC + "Annotation").items()
    },
    **{
        key: value
        for namespace in (SSD, SSV, SSB)
        for plural, single in (("Units", "Unit"), ("Enumerations", "Enumeration"))
        for key, value in _list(namespace + plural, SSC + single).items()
    },
}
