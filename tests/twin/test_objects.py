"""The object dictionary: read by canopen's importer, with the LWA 4P's mapping, and nothing that frames cannot hold."""

import pytest

from armwright.errors import BusError
from armwright.twin import objects as od
from raises_at import raises_at

pytest.importorskip("canopen", reason='pip install "armwright[twin]"')


def test_the_eds_has_every_entry_with_its_type_access_and_default():
    found = od.dictionary(od.eds_text(5, "arm joint1", {od.SERIAL: 77, od.HIGHEST: -3}), 5)
    for (index, sub), entry in od.ENTRIES.items():
        variable = found[index] if index not in od.RECORDS else found[index][sub]
        assert variable.data_type == entry.kind.code, hex(index)
        assert variable.access_type == entry.access
        assert variable.pdo_mappable == entry.mapped
        if isinstance(entry.default, int) and (index, sub) not in (od.SERIAL, od.HIGHEST):
            assert variable.default == entry.default, hex(index)
            assert od.bounds(entry.kind)[0] <= entry.default <= od.bounds(entry.kind)[1]
    assert found[0x1018][4].default == 77
    assert found[0x607D][2].default == -3
    assert found[0x1400][1].default == 0x205
    assert found[0x1801][1].default == 0x80000285


def test_the_eds_has_the_objects_of_a_drive_by_cia_402():
    found = od.dictionary(od.eds_text(3, "arm joint1", {}), 3)
    wanted = {
        0x605A,
        0x605B,
        0x605C,
        0x605D,
        0x605E,
        0x6075,
        0x6078,
        0x6099,
        0x609A,
        0x60B0,
        0x60B1,
        0x60B2,
        0x60FD,
        0x60FE,
    }
    assert wanted <= set(found)
    assert [found[index].default for index in range(0x605A, 0x605F)] == [2, 0, 1, 1, 2]  # as the standard has them
    assert {len(found[index]) for index in (0x6099, 0x60FE)} == {3}  # with the number of their parts


def test_defaults_are_values_that_are_not_refused():
    for key, values in od.CHOICES.items():
        assert od.ENTRIES[key].default in values
        assert od.bounds(od.ENTRIES[key].kind)[0] <= min(values)


def test_the_mapping_is_the_lwa_4ps():
    assert od.mapping(od.RECEIVED) == [0x60400010, 0x60B20010, 0x60C10120]
    assert od.mapping(od.SENT) == [0x60410010, 0x60770010, 0x60640020]
    assert od.packing(od.RECEIVED).size == od.packing(od.SENT).size == 8


def test_more_than_a_frame_is_refused():
    with raises_at(BusError, "PDO", "80 bits.* 64", value="6064:0, 6064:0, 6041:0"):
        od.mapping((od.POSITION, od.POSITION, od.STATUSWORD))
