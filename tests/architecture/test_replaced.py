import pytest
from msgspec import structs

from hardcore.settings import Fault


def test_a_replaced_field_is_one_of_the_struct_and_the_type_check_says_so_first() -> None:
    one = Fault("mode", "is none")
    # Neither comment would be needed if the plugin did not look: the type check refuses comments without need.
    structs.replace(one, reason=1)  # type: ignore[arg-type]  # a struct asks nobody for its types
    with pytest.raises(TypeError, match="nothing"):
        structs.replace(one, nothing=1)  # type: ignore[call-arg]  # and knows its fields
