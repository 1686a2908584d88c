"""The grammar of SSP's files: which elements and attributes are legal where, and which of them are supported.

SSP 1.0, sections 4 to 6, with what SSP 2.0 adds listed as not supported yet, so that it is reported and never passed
over. Geometry is legal everywhere the standard has it and is not looked into.
"""

from __future__ import annotations

from cosim_master.document import Form, Grammar
from cosim_master.units import BASE_UNITS

__all__ = [
    "ANNOTATIONS",
    "ANY_TYPE",
    "GRAMMAR",
    "KINDS",
    "KINDS_LATER",
    "PARAMETER_TYPES",
    "SSC",
    "SSD",
    "SSV",
    "TYPES",
]

SSD = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"
SSC = "{http://ssp-standard.org/SSP1/SystemStructureCommon}"
SSV = "{http://ssp-standard.org/SSP1/SystemStructureParameterValues}"

_BASE = ("id", "description")
_TOP = (*_BASE, "author", "fileversion", "copyright", "license", "generationTool", "generationDateAndTime")
TYPES = ("Real", "Integer", "Boolean", "String", "Enumeration", "Binary")
TYPES_2 = ("Float64", "Float32", *(f"{sign}Int{width}" for sign in ("", "U") for width in (8, 16, 32, 64)), "Clock")
_META_2 = frozenset({SSC + "MetaData", SSC + "Signature"})
KINDS = ("input", "output", "parameter", "calculatedParameter")
KINDS_LATER = ("inout", "structuralParameter", "constant", "local", "unspecified")
ANNOTATIONS = SSD + "Annotations"


def _ssc(*names: str) -> tuple[str, ...]:
    return tuple(SSC + name for name in names)


def _ssd(*names: str) -> tuple[str, ...]:
    return tuple(SSD + name for name in names)


def _annotations(namespace: str) -> Grammar:
    children = _ssc("Annotation")
    return {namespace + "Annotations": Form(children=children, repeated=frozenset(children), mandatory=children)}


ANY_TYPE = frozenset(_ssc(*TYPES))
PARAMETER_TYPES = tuple(SSV + name for name in TYPES)

GRAMMAR: Grammar = {
    SSD + "SystemStructureDescription": Form(
        required=("version", "name"),
        optional=_TOP,
        children=_ssd("System", "Enumerations", "Units", "DefaultExperiment", "Annotations"),
        mandatory=_ssd("System"),
        unsupported=_META_2,
    ),
    SSD + "System": Form(
        required=("name",),
        optional=_BASE,
        children=_ssd(
            "Connectors",
            "ElementGeometry",
            "ParameterBindings",
            "Elements",
            "Connections",
            "SystemGeometry",
            "GraphicalElements",
            "Annotations",
        ),
        unsupported=frozenset(_ssd("SignalDictionaries")) | _META_2,
    ),
    SSD + "Component": Form(
        required=("name", "source"),
        optional=(*_BASE, "type", "implementation"),
        children=_ssd("Connectors", "ElementGeometry", "ParameterBindings", "Annotations"),
        unsupported=_META_2 | {"path"},
    ),
    SSD + "Connectors": Form(
        children=_ssd("Connector"), repeated=frozenset(_ssd("Connector")), mandatory=_ssd("Connector")
    ),
    SSD + "Connector": Form(
        required=("name", "kind"),
        optional=_BASE,
        children=(*_ssc(*TYPES), *_ssd("ConnectorGeometry", "Annotations")),
        choices=(ANY_TYPE,),
        unsupported=frozenset(_ssc(*TYPES_2, "Dimension")) | frozenset(_ssd("Clock")) | _META_2,
    ),
    SSD + "Elements": Form(
        children=_ssd("Component", "System"),
        repeated=frozenset(_ssd("Component", "System")),
        filled=True,
        unsupported=frozenset(_ssd("SignalDictionaryReference")),
    ),
    SSD + "Connections": Form(
        children=_ssd("Connection"), repeated=frozenset(_ssd("Connection")), mandatory=_ssd("Connection")
    ),
    SSD + "Connection": Form(
        required=("startConnector", "endConnector"),
        optional=(*_BASE, "startElement", "endElement", "suppressUnitConversion"),
        children=(*_ssc("LinearTransformation"), *_ssd("ConnectionGeometry", "Annotations")),
        unsupported=frozenset(
            _ssc("BooleanMappingTransformation", "IntegerMappingTransformation", "EnumerationMappingTransformation")
        )
        | _META_2
        | {"startIndices", "endIndices"},
    ),
    SSC + "LinearTransformation": Form(optional=("factor", "offset")),
    SSD + "ParameterBindings": Form(
        children=_ssd("ParameterBinding"),
        repeated=frozenset(_ssd("ParameterBinding")),
        mandatory=_ssd("ParameterBinding"),
    ),
    SSD + "ParameterBinding": Form(
        optional=(*_BASE, "type", "source", "sourceBase", "prefix"),
        children=_ssd("ParameterValues", "Annotations"),
        unsupported=frozenset(_ssd("ParameterMapping")) | _META_2,
    ),
    SSD + "ParameterValues": Form(children=(SSV + "ParameterSet",), mandatory=(SSV + "ParameterSet",)),
    SSV + "ParameterSet": Form(
        required=("version", "name"),
        optional=_TOP,
        children=tuple(SSV + name for name in ("Parameters", "Enumerations", "Units", "Annotations")),
        mandatory=(SSV + "Parameters",),
        unsupported=_META_2,
    ),
    SSV + "Parameters": Form(children=(SSV + "Parameter",), repeated=frozenset({SSV + "Parameter"})),
    SSV + "Parameter": Form(
        required=("name",),
        optional=_BASE,
        children=(*PARAMETER_TYPES, SSV + "Annotations"),
        choices=(frozenset(PARAMETER_TYPES),),
        unsupported=frozenset(SSV + name for name in TYPES_2) | _META_2,
    ),
    SSV + "Real": Form(required=("value",), optional=("unit",)),
    SSV + "Integer": Form(required=("value",)),
    SSV + "Boolean": Form(required=("value",)),
    SSV + "String": Form(required=("value",)),
    SSV + "Enumeration": Form(required=("value",), optional=("name",)),
    SSD + "DefaultExperiment": Form(optional=("startTime", "stopTime"), children=_ssd("Annotations")),
    SSC + "Annotation": Form(required=("type",), opaque=True),
    SSC + "Real": Form(optional=("unit",)),
    SSC + "Integer": Form(),
    SSC + "Boolean": Form(),
    SSC + "String": Form(),
    SSC + "Enumeration": Form(required=("name",)),
    SSC + "Binary": Form(optional=("mime-type",)),
    SSC + "Unit": Form(
        required=("name",),
        optional=_BASE,
        children=_ssc("BaseUnit", "Annotations"),
        mandatory=_ssc("BaseUnit"),
        unsupported=frozenset({SSC + "DisplayUnit"}) | _META_2,
    ),
    SSC + "BaseUnit": Form(optional=(*BASE_UNITS, "factor", "offset")),
    # The definition of an enumeration; ssc:Enumeration itself is the type of a connector.
    SSC + "Enumeration type": Form(
        required=("name",),
        optional=_BASE,
        children=_ssc("Item", "Annotations"),
        repeated=frozenset(_ssc("Item")),
        mandatory=_ssc("Item"),
        unsupported=_META_2,
    ),
    SSC + "Item": Form(required=("name", "value")),
    **_annotations(SSD),
    **_annotations(SSC),
    **_annotations(SSV),
    **{
        namespace + plural: Form(children=_ssc(single), repeated=frozenset(_ssc(single)), mandatory=_ssc(single))
        for namespace in (SSD, SSV)
        for plural, single in (("Units", "Unit"), ("Enumerations", "Enumeration"))
    },
}
