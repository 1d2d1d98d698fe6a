"""The use of a block's data: tracked estimate, sudden changes, gusts, undeclared wind, uncertainty level."""
